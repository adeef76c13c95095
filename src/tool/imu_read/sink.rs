//! Samples on their way out: axes, standard deviations, window, count.

use super::NAME;
use super::arguments::SampleArgs;
use crate::frame::{Frame, Imu, ImuAxes};
use crate::gx1::samples::{self, Remark};
use crate::gx1::{Command, Samples};
use crate::record::{Axes, ImuSample, Stamp};
use crate::stream::{Options, Output, Place, WindowState};

/// Gaps of fewer samples than this are only counted, unless -v asks for each: a bad line would fill
/// the screen.
const GAP_SAID: u64 = 20;

/// Writes samples.
pub(super) struct Sink {
    output: Output,
    window: WindowState,
    dress: Dress,
    written: u64,
    limit: u64,
    done: bool,
    quiet: bool,
    verbose: u8,
}

/// The axes asked for, and the standard deviations.
struct Dress {
    axes: Axes,
    mounting: ImuAxes,
    tilt_sigma_rad: f64,
    yaw_sigma_rad: f64,
    gyro_sigma_rad_s: f64,
    accel_sigma_m_s2: f64,
}

impl Sink {
    /// Opens the output; `limit` samples at most.
    pub(super) fn open(
        options: &Options,
        args: &SampleArgs,
        frame: Option<&Frame>,
        commands: &[Command],
        limit: Option<u64>,
    ) -> anyhow::Result<Sink> {
        let level = Imu {
            rotation_deg: [0.0; 3],
        };
        let dress = Dress {
            axes: args.axes,
            mounting: ImuAxes::new(frame.map_or(&level, |frame| &frame.imu)),
            tilt_sigma_rad: args.sigma_tilt_deg.to_radians(),
            yaw_sigma_rad: args.sigma_yaw_deg.to_radians(),
            gyro_sigma_rad_s: args.sigma_gyro_rad_s,
            accel_sigma_m_s2: args.sigma_accel_m_s2,
        };
        let mut output = Output::open(options)?;
        output.columns_like(&dress.put_on(&whole(commands)))?;
        Ok(Sink {
            output,
            window: WindowState::new(options.window),
            dress,
            written: 0,
            limit: limit.unwrap_or(u64::MAX),
            done: false,
            quiet: options.quiet,
            verbose: options.verbose,
        })
    }

    /// Writes what is complete; whether anything was written.
    pub(super) fn drain(&mut self, samples: &mut Samples) -> anyhow::Result<bool> {
        let before = self.written;
        while let Some(remark) = samples.next_remark() {
            self.remark(remark);
        }
        while !self.done
            && let Some(sample) = samples.next_sample()
        {
            match self.window.place(sample.stamp) {
                Place::Inside => {
                    self.output.write(&self.dress.put_on(&sample))?;
                    self.written += 1;
                    self.done = self.written >= self.limit;
                }
                Place::After => self.done = true,
                Place::Before => {}
            }
        }
        Ok(self.written > before)
    }

    fn remark(&self, remark: Remark) {
        if self.quiet {
            return;
        }
        match remark {
            Remark::Gap { missing, seq } if missing >= GAP_SAID || self.verbose > 0 => {
                eprintln!("{NAME}: {missing} samples are missing before seq {seq}");
            }
            Remark::Gap { .. } => {}
            Remark::Restarted { seq } => eprintln!(
                "{NAME}: the unit was switched off and on before seq {seq}: its clock begins anew"
            ),
        }
    }

    /// Whether as many samples as asked for have been written, or the window has passed.
    pub(super) fn done(&self) -> bool {
        self.done
    }

    /// Lets everything go out; to be called before waiting.
    pub(super) fn flush(&mut self) -> anyhow::Result<()> {
        self.output.flush()
    }

    /// Ends the output; how many samples were written.
    pub(super) fn finish(self) -> anyhow::Result<u64> {
        self.output.finish_kind::<ImuSample>()?;
        Ok(self.written)
    }
}

impl Dress {
    /// A sample in the axes asked for, with its standard deviations.
    fn put_on(&self, sample: &ImuSample) -> ImuSample {
        let mut sample = self.mounting.turned(sample, self.axes);
        if sample.roll_rad.is_finite() {
            sample.roll_sigma_rad = self.tilt_sigma_rad;
            sample.pitch_sigma_rad = self.tilt_sigma_rad;
            sample.yaw_sigma_rad = self.yaw_sigma_rad;
        }
        if sample.gyro_x_rad_s.is_finite() {
            sample.gyro_sigma_rad_s = self.gyro_sigma_rad_s;
        }
        if sample.accel_x_m_s2.is_finite() {
            sample.accel_sigma_m_s2 = self.accel_sigma_m_s2;
        }
        sample
    }
}

/// A sample with all that these commands can give, for the columns.
fn whole(commands: &[Command]) -> ImuSample {
    let known = |is: bool| if is { 0.0 } else { f64::NAN };
    let [attitude, accel, gyro, mag] = samples::quantities(commands).map(known);
    ImuSample {
        received: Some(Stamp::default()),
        device: Some(Stamp::default()),
        axes: Axes::Ned,
        roll_rad: attitude,
        pitch_rad: attitude,
        yaw_rad: attitude,
        gyro_x_rad_s: gyro,
        gyro_y_rad_s: gyro,
        gyro_z_rad_s: gyro,
        accel_x_m_s2: accel,
        accel_y_m_s2: accel,
        accel_z_m_s2: accel,
        mag_x_gauss: mag,
        mag_y_gauss: mag,
        mag_z_gauss: mag,
        ..ImuSample::default()
    }
}
