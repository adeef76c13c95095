//! timesync delay: how late a measurement is.

use super::TOOL;
use crate::clock::delay::{
    self, DelayFit, DelaySettings, Dissertation, Measured, Part, correlation,
};
use crate::link::HostInstant;
use crate::motion::Sampled;
use crate::record::{DelayPoint, Pose, Stamp, TrajectoryPoint};
use crate::stream::{Encoding, Fault, Input, Options, Outcome, Output, Role, WholeFile};
use crate::tool::arguments::CommonArgs;
use crate::tool::values::{parse_duration, parse_signed_duration};
use nalgebra::Vector3;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;

/// The delay between a desired trajectory and the measured poses
///
/// Positive: the measurement lags. Both must be stamped by one clock. The recommended fit is least
/// squares on delay, gain and offset, with weights that know of jitter and of outliers; its standard
/// error is honest. The delay is also given by direction and by phase of the motion: values that
/// differ tell of the platform's dynamics, not of transport.
///
/// The procedure of the dissertation (Kurniawan 2017, section 5.2 and Fig. 5.21) is there by its
/// name: total delay from stamp to now (for a live stream), plain cross-correlation, and a manual
/// adjustment by --adjust.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Measured poses, CSV or MCAP [default: stdin]
    #[arg(value_name = "POSES")]
    input: Option<PathBuf>,
    /// The desired trajectory, CSV or MCAP
    #[arg(long, value_name = "FILE")]
    desired: PathBuf,
    /// How the delay is found
    #[arg(long, value_enum, value_name = "METHOD", default_value_t = How::Fit)]
    method: How,
    /// Axes that are used, such as yz [default: those along which the desired trajectory goes]
    #[arg(long, value_name = "AXES", value_parser = parse_axes)]
    axes: Option<[bool; 3]>,
    /// The delay is searched between plus and minus this
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = parse_duration)]
    max_delay: Duration,
    /// Take the measurement's scale as true
    #[arg(long)]
    fixed_gain: bool,
    /// Take the measurement's zero as true
    #[arg(long)]
    fixed_offset: bool,
    /// dissertation: what is added to the delay by hand, with its sign: 8ms, -3ms
    #[arg(long, value_name = "TIME", value_parser = parse_signed_duration, allow_hyphen_values = true)]
    adjust: Option<f64>,
    /// Write the error that is left for each delay to FILE, records of kind delay
    #[arg(long, value_name = "FILE")]
    curve: Option<PathBuf>,
    /// Step of that curve
    #[arg(long, value_name = "TIME", default_value = "1ms", value_parser = parse_duration, requires = "curve")]
    curve_step: Duration,
    /// Write the result as JSON (delay_s, sigma_s, ...), which compensate-delay --delay-from reads
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonArgs,
}

/// Ways to find a delay.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum How {
    /// Delay, gain and offset by weighted, robust least squares
    Fit,
    /// Plain cross-correlation: drawn to zero where the platform rests
    Xcorr,
    /// Correlation normalised on each overlap, with a parabola through its peak
    Parabolic,
    /// One linear step by the desired velocity
    Derivative,
    /// As in the dissertation: total delay, cross-correlation, --adjust by hand
    Dissertation,
}

/// What is printed.
#[derive(Debug, Serialize)]
struct Report {
    method: How,
    delay_s: f64,
    /// None for methods that state no error.
    sigma_s: Option<f64>,
    samples: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    fit: Option<DelayFit>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dissertation: Option<Dissertation>,
}

/// A stamp older than this when it is read comes from a recording, s.
const LIVE_S: f64 = 60.0;

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let options = args.common.options(TOOL)?;
    if args.common.format.is_some() && args.curve.is_none() {
        let what = "delay writes text, or --json: --format is for --curve FILE";
        return Err(Fault::Usage(what.into()).into());
    }
    if args.adjust.is_some() && args.method != How::Dissertation {
        return Err(Fault::Usage("--adjust goes with --method dissertation".into()).into());
    }
    let output = WholeFile::open(args.common.output.as_deref())?;
    let (motion, start) = desired(args, &options)?;
    let (measured, total_s) = measured(args, &options, start)?;
    let settings = DelaySettings {
        axes: args.axes,
        most_s: args.max_delay.as_secs_f64(),
        free_gain: !args.fixed_gain,
        free_offset: !args.fixed_offset,
    };
    let report = find(args, &measured, &motion, &settings, total_s)
        .map_err(|error| Fault::BadData(error.to_string()))?;
    if let Some(path) = &args.curve {
        let encoding = options.format.unwrap_or(Encoding::Csv);
        let mut output = Output::create(path, encoding, &options)?;
        let step_s = args.curve_step.as_secs_f64().max(1e-6);
        let count = (args.max_delay.as_secs_f64() / step_s).floor().min(1e6) as i64;
        let delays_s = (-count..=count).map(|k| k as f64 * step_s);
        for point in delay::curve(&measured, &motion, start, delays_s) {
            output.write(&point)?;
        }
        output.finish_kind::<DelayPoint>()?;
    }
    let text = match args.json {
        true => serde_json::to_string_pretty(&report)? + "\n",
        false => words(&report),
    };
    output.finish(&text)?;
    Ok(Outcome::Done)
}

/// The desired motion and its first instant.
fn desired(args: &Args, options: &Options) -> anyhow::Result<(Sampled, Stamp)> {
    let options = Options {
        window: Default::default(),
        quiet: true,
        ..options.clone()
    };
    let mut input =
        Input::<TrajectoryPoint>::open_trajectory(Some(&args.desired), Role::Desired, &options)?;
    let mut points = Vec::new();
    while let Some(point) = input.next()? {
        points.push(*point);
    }
    let name = args.desired.display();
    let motion =
        Sampled::new(&points).map_err(|error| Fault::BadData(format!("{name}: {error}")))?;
    let start = points.first().map_or(Stamp::default(), |point| point.stamp);
    Ok((motion, start))
}

/// The measured positions, and the median time from stamp to now where they come live.
fn measured(
    args: &Args,
    options: &Options,
    start: Stamp,
) -> anyhow::Result<(Vec<Measured>, Option<f64>)> {
    let mut input: Input<Pose> = Input::open(args.input.as_deref(), options)?;
    let (mut measured, mut ages_s) = (Vec::new(), Vec::new());
    while let Some(pose) = input.next()? {
        ages_s.push(HostInstant::now().utc.since_s(pose.stamp));
        measured.push(Measured {
            t_s: pose.stamp.since_s(start),
            position_m: Vector3::from(pose.position_m),
        });
    }
    measured.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    ages_s.sort_by(f64::total_cmp);
    let live = |age: &f64| (0.0..LIVE_S).contains(age);
    let total_s = ages_s.get(ages_s.len() / 2).copied().filter(live);
    Ok((measured, total_s))
}

fn find(
    args: &Args,
    measured: &[Measured],
    motion: &Sampled,
    settings: &DelaySettings,
    total_s: Option<f64>,
) -> Result<Report, delay::DelayError> {
    let plain = |delay_s: f64| Report {
        method: args.method,
        delay_s,
        sigma_s: None,
        samples: measured.len(),
        fit: None,
        dissertation: None,
    };
    match args.method {
        How::Fit => {
            let found = delay::fit(measured, motion, settings)?;
            Ok(Report {
                sigma_s: Some(found.sigma_s),
                samples: found.samples,
                fit: Some(found.clone()),
                ..plain(found.delay_s)
            })
        }
        How::Xcorr => correlation::plain(measured, motion, settings).map(plain),
        How::Parabolic => correlation::parabolic(measured, motion, settings).map(plain),
        How::Derivative => correlation::derivative(measured, motion, settings).map(plain),
        How::Dissertation => {
            let adjustment_s = args.adjust.unwrap_or(0.0);
            let steps = delay::dissertation(measured, motion, settings, total_s, adjustment_s)?;
            Ok(Report {
                dissertation: Some(steps),
                ..plain(steps.delay_s())
            })
        }
    }
}

fn words(report: &Report) -> String {
    let mut text = String::new();
    let mut row = |name: &str, value: String| {
        let _ = writeln!(text, "{name:<18}{value}");
    };
    let ms = |seconds: f64| format!("{:+.4} ms", seconds * 1e3);
    let sigma = |s: f64| format!(" +- {:.4} ms", s * 1e3);
    row(
        "delay",
        format!(
            "{}{} (positive: the measurement lags)",
            ms(report.delay_s),
            report.sigma_s.map_or(String::new(), sigma)
        ),
    );
    row("samples", report.samples.to_string());
    if let Some(found) = &report.fit {
        row("outliers", found.outliers.to_string());
        for axis in &found.axes {
            let name = ["x", "y", "z"].get(axis.axis).copied().unwrap_or("?");
            row(
                name,
                format!(
                    "gain {:.6}, offset {:+.2} mm, noise {:.2} mm, jitter {:.2} ms",
                    axis.gain,
                    axis.offset_m * 1e3,
                    axis.noise_m * 1e3,
                    axis.jitter_s * 1e3
                ),
            );
        }
        for part in &found.parts {
            let name = match part.part {
                Part::Out => "out",
                Part::Back => "back",
                Part::Accelerating => "accelerating",
                Part::Cruising => "cruising",
                Part::Decelerating => "decelerating",
            };
            let value = format!(
                "{}{}, {} samples",
                ms(part.delay_s),
                sigma(part.sigma_s),
                part.samples
            );
            row(name, value);
        }
    }
    if let Some(steps) = &report.dissertation {
        let spike = |k: usize| match steps.spike_m.get(k).filter(|m| m.is_finite()) {
            Some(m) => format!("spike {:.2} mm", m * 1e3),
            None => "spike not known".to_owned(),
        };
        row("not compensated", spike(0));
        match steps.total_delay_s {
            Some(total_s) => row("total delay", format!("{}, {}", ms(total_s), spike(1))),
            None => row(
                "total delay",
                "not known: the poses are not live".to_owned(),
            ),
        }
        let correlated = ms(steps.cross_correlation_s);
        row("cross-correlation", format!("{correlated}, {}", spike(2)));
        row(
            "adjusted by hand",
            format!("{}, {}", ms(steps.adjustment_s), spike(3)),
        );
        row("best adjustment", ms(steps.best_adjustment_s));
    }
    text
}

fn parse_axes(text: &str) -> Result<[bool; 3], String> {
    let mut axes = [false; 3];
    for letter in text.chars() {
        let axis = "xyz".find(letter).and_then(|k| axes.get_mut(k));
        *axis.ok_or_else(|| "letters out of x, y and z are wanted".to_owned())? = true;
    }
    match axes {
        [false, false, false] => Err("letters out of x, y and z are wanted".to_owned()),
        _ => Ok(axes),
    }
}
