//! ads-push: poses in, the controller's variables written, the same poses out.

mod args;
mod mailbox;
mod poses;
mod questions;
mod run;
mod session;
mod spans;
mod trajectory;

use crate::link::waker;
use crate::stream::{Fault, Options, Outcome, Stop};
use crate::twincat::fields::Field;
use args::{ReadTime, WholeArgs};
use mailbox::Mailbox;
use poses::Handing;
use run::{Run, Wishes};
use session::{Link, ReadPlan, WritePlan};
use std::sync::Arc;
use trajectory::Trajectory;

/// The name in messages and provenance.
const TOOL: &str = "ads-push";

const MORE: &str = "\
FIELDS
  x y z (m, mm, um), roll pitch yaw (rad, deg, mrad), sigma_x .. sigma_yaw (the same units), vx
  vy vz (m/s, mm/s; read only), range_bias (m, mm, um), stamp and scan_stamp (s, ms, us, 100ns,
  ns since @1601, @1970 or @2000; filetime is 100ns@1601, dc is ns@2000), age (s, ms, us, ns:
  from the stamp to the write), status, sequence (number of the scan), counter (number of the
  write), edges, votes, valid (1 for a whole, fresh pose), _ (0).
  The first unit is the default; another one stands behind a colon: yaw:deg, stamp:filetime.
  An array takes fields in order, a structure by the names of its members: --fields
  fX=x:mm,fYaw=yaw:deg.
  Several variables are written in one request: MAIN.fX=x:mm MAIN.nStatus=status.

STATUS WORD
  Bit 0 no-pose, 1 no-upper, 2 one-wall, 3 no-walls, 4 no-edges, 5 few-edges, 6 no-yaw, 7
  edge-outlier, 8 no-imu, 9 stale-imu, 10 extrapolated, 11 re-acquired, 12 disagree, 13
  extrapolated-too-far, 14 stale-motion: what the pose's own status says.
  Bit 16: no new pose for longer than --stale. Bit 17: ads-push has ended.
  A counter that stands still means that ads-push or the line to it is gone: the PLC must watch
  it.
  packaging/twincat has a function block that does.

WHAT IS SAFE
  Before the first write, after every connection and after every change of the program, name,
  type and size of the variables are compared with the fields. Where they do not fit nothing is
  written, both sides are shown, and the status is 78. One request holds all of a pose: the PLC
  never sees half of one. A pose without numbers is written as its status and the last numbers
  (--missing): a NaN can stop a PLC.
  When the controller is slower than the poses the newest one is written, and those that it
  passed over are counted: that is no loss. Poses that came while there was no connection, or
  were not acknowledged, are one: the status is 3. Poses go on to stdout in any case, byte by
  byte as they came (with --format, -o, --from, --to, --skip-bad or --stamp-push they are
  written anew).

WHERE PEOPLE TRIP
  A controller keeps one TCP connection for each host. A second program on the same host,
  another ads-push or TwinCAT XAE, ends the first one's. Let one ads-push do both: push, and
  --read SYMBOL --read-to FIFO. Or run on the IPC itself: through its router (TARGET
  127.0.0.1/NETID, where a port is asked for) any number of programs share the connection.
  TwinCAT before 4024.5 wants EnableAmsTcpLoopback=1 in its registry for that.
  The controller needs a route to this host's NetId and address: --add-route asks for one; user
  and password go over the network in the clear, as with every tool that does this.
  Secure ADS (TLS, port 8016) is not spoken. Plain ADS belongs on a wire or a VLAN of its own.
  A TARGET that is an address or a name stands for the NetId address.1.1.

EXAMPLES
  The bytes that the published form of the variable gets, for the first pose:
    head -n 2 poses.csv | ads-push 192.0.2.10.1.1 MAIN.SickValue --dry-run
  The same in millimetres and degrees, into a structure of REALs with a counter behind them:
    head -n 2 poses.csv | ads-push 192.0.2.10.1.1 MAIN.stPose --dry-run \\
      --layout 3*REAL,REAL,UDINT,UDINT --fields x:mm,y:mm,z:mm,yaw:deg,status,counter
  And as one variable a field:
    head -n 2 poses.csv | ads-push plc/192.0.2.10.1.1 MAIN.fX=x MAIN.n=counter --dry-run

WITH A CONTROLLER
  ads-push --add-route --route-credentials plc.txt 192.0.2.10.1.1
  ads-push list 192.0.2.10.1.1 'MAIN.*'
  ads-push check 192.0.2.10.1.1 MAIN.SickValue
  scan-capture lms.local | extract-lines -f frame.toml | solve-pose -f frame.toml
  | ads-push 192.0.2.10.1.1 MAIN.SickValue | tee run.csv | report -
  ads-push 192.0.2.10.1.1 --read GVL.stDesired --read-fields stamp:dc,x,y,z,vx,vy,vz > d.csv";

/// The command line.
#[derive(Debug, clap::Parser)]
#[command(
    name = "ads-push",
    version,
    about = "Write poses to a TwinCAT controller, and read its desired motion",
    long_about = "Write poses to a TwinCAT controller, and read its desired motion.\n\n\
        Poses come on stdin, are written to variables of a TwinCAT 3 PLC over ADS, and go on to stdout \
        unchanged. What is written has a status, a counter and an age, so that the PLC knows whether to \
        trust it. The connection is made again whenever it is lost; the poses flow on meanwhile.",
    after_long_help = MORE,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true
)]
pub struct Args {
    #[command(subcommand)]
    task: Option<Task>,
    #[command(flatten)]
    whole: WholeArgs,
}

#[derive(Debug, clap::Subcommand)]
enum Task {
    Check(questions::CheckArgs),
    List(questions::ListArgs),
}

/// Pushes, reads, or asks.
///
/// # Errors
/// See [`crate::stream::exit`]: 69 without the controller, 78 where variables and fields do not fit.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    match args.task {
        Some(Task::Check(args)) => questions::check(args),
        Some(Task::List(args)) => questions::list(&args),
        None => whole(args.whole),
    }
}

fn usage(text: &str) -> anyhow::Error {
    Fault::Usage(text.to_owned()).into()
}

fn whole(args: WholeArgs) -> anyhow::Result<Outcome> {
    args.link.check()?;
    let options = args.common.options(TOOL)?;
    let target = args
        .target
        .clone()
        .ok_or_else(|| usage("TARGET is missing"))?;
    let write = (!args.symbols.is_empty()).then(|| WritePlan {
        symbols: args.symbols.clone(),
        layout: args.layout.clone(),
    });
    check_fields(&args)?;
    if args.push.dry_run {
        let plan = write.ok_or_else(|| usage("--dry-run: which SYMBOL?"))?;
        return questions::rehearse(&target, &plan, &options);
    }
    if args.route.add_route {
        questions::add_route(&target, &args.link, &args.route)?;
    }
    let read = read_plan(&args)?;
    match (&write, &read) {
        (None, None) if args.route.add_route => return Ok(Outcome::Done),
        (None, None) => {
            return Err(usage(
                "which variable? Give SYMBOL to write to, or --read SYMBOL (ads-push list TARGET \
                 shows them)",
            ));
        }
        (Some(_), Some(_)) if args.read.read_to.is_none() => {
            return Err(usage(
                "--read beside a push: give --read-to FILE, stdout has the poses",
            ));
        }
        (None, Some(_)) if args.read.read_to.is_some() => {
            return Err(usage(
                "--read-to: without a push the trajectory goes to stdout or -o",
            ));
        }
        _ => {}
    }
    let wishes = Wishes {
        link: Link {
            target,
            local: args.link.local(),
            timeout: args.link.timeout,
        },
        write,
        read,
        every: args.push.every || args.push.stamp_push,
        stale: args.push.stale,
        wait: args.push.wait,
        quiet: args.common.quiet,
        verbose: args.common.verbose > 0,
    };
    start(&args, wishes, &options)
}

fn start(args: &WholeArgs, wishes: Wishes, options: &Options) -> anyhow::Result<Outcome> {
    let (waker, waiter) = waker()?;
    let pushes = wishes.write.is_some();
    let stop = if pushes {
        Stop::install_for_filter()?
    } else {
        Stop::install()?
    };
    let trajectory = wishes.read.as_ref().map(|read| {
        let to = args.read.read_to.clone().filter(|_| pushes);
        Trajectory::start(options, to, read.time, args.read.count)
    });
    let mailbox = pushes.then(|| Arc::new(Mailbox::new(waker)));
    if let Some(mailbox) = &mailbox {
        let handing = match (args.push.stamp_push, args.push.every) {
            (true, _) => Handing::Stamped,
            (false, true) => Handing::Every,
            (false, false) => Handing::Newest,
        };
        poses::read(options.clone(), handing, mailbox);
    }
    Run::new(wishes, mailbox, trajectory, waiter, stop).run()
}

/// Fields that cannot be written or read.
fn check_fields(args: &WholeArgs) -> anyhow::Result<()> {
    let listed = args.layout.fields.iter().flat_map(|fields| &fields.0);
    let named = args
        .symbols
        .iter()
        .filter_map(|wanted| wanted.field.as_ref());
    if let Some(field) = listed.chain(named).find(|field| !field.is_writable()) {
        return Err(usage(&format!(
            "{field}: a pose has none; it can be read only"
        )));
    }
    let mut read = args.read.read_fields.iter().flat_map(|fields| &fields.0);
    if let Some(field) = read.find(|field| !field.is_readable()) {
        return Err(usage(&format!(
            "--read-fields: a trajectory has no {field}"
        )));
    }
    Ok(())
}

fn read_plan(args: &WholeArgs) -> anyhow::Result<Option<ReadPlan>> {
    let Some(symbol) = args.read.read.clone() else {
        return Ok(None);
    };
    let mut fields = args.read.read_fields.iter().flat_map(|fields| &fields.0);
    let stamped = fields.any(Field::is_stamp);
    match args.read.read_time {
        Some(ReadTime::Mapped | ReadTime::Plc) if !stamped => {
            return Err(usage(
                "--read-time mapped and plc want a field stamp in --read-fields",
            ));
        }
        Some(ReadTime::Notified) if args.read.poll.is_some() => {
            return Err(usage(
                "--read-time notified: a polled value has no notification",
            ));
        }
        _ => {}
    }
    let usual = if stamped {
        ReadTime::Mapped
    } else {
        ReadTime::Arrival
    };
    let period = args.read.poll.unwrap_or(args.read.read_period);
    if period.is_zero() {
        return Err(usage("--read-period, --poll: a time above 0 is wanted"));
    }
    Ok(Some(ReadPlan {
        symbol,
        fields: args.read.read_fields.clone(),
        layout: args.read.read_layout.clone(),
        time: args.read.read_time.unwrap_or(usual),
        period,
        polled: args.read.poll.is_some(),
    }))
}
