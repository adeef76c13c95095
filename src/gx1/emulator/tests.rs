use super::*;
use crate::gx1::Packet;
use crate::gx1::attitude as attitude_of;
use crate::gx1::scale::{self, Gains};
use crate::record::Axes;

/// Turns about the vertical at a constant rate, tilted.
struct Turning;

const TILT: [f64; 2] = [0.1, -0.05];
const RATE_RAD_S: f64 = 0.2;

impl Senses for Turning {
    fn sample(&mut self, now_ns: i64) -> ImuSample {
        let yaw = RATE_RAD_S * now_ns as f64 * 1e-9;
        let down = nalgebra::UnitQuaternion::from_euler_angles(TILT[0], TILT[1], yaw).inverse()
            * nalgebra::Vector3::z();
        let rate = down * RATE_RAD_S;
        ImuSample {
            axes: Axes::Ned,
            roll_rad: TILT[0],
            pitch_rad: TILT[1],
            yaw_rad: yaw,
            gyro_x_rad_s: rate.x,
            gyro_y_rad_s: rate.y,
            gyro_z_rad_s: rate.z,
            accel_x_m_s2: -9.81 * down.x,
            accel_y_m_s2: -9.81 * down.y,
            accel_z_m_s2: -9.81 * down.z,
            ..ImuSample::default()
        }
    }
}

struct Bench {
    unit: Emulator<Turning>,
    out: Outbox,
    now_ns: i64,
}

impl Bench {
    fn new(behaviour: Behaviour) -> Bench {
        let mut unit = Emulator::new(behaviour, Turning);
        unit.connected(0, 0, 0);
        Bench {
            unit,
            out: Outbox::default(),
            now_ns: 0,
        }
    }

    fn say(&mut self, bytes: &[u8]) {
        self.unit.input(0, bytes, self.now_ns, &mut self.out);
    }

    /// What it sends within `ms`, with the time at which each message begins.
    fn hear(&mut self, ms: i64) -> Vec<(i64, Vec<u8>)> {
        let end_ns = self.now_ns + ms * 1_000_000;
        let mut heard = Vec::new();
        while let Some(due_ns) = self.unit.due_ns().filter(|due_ns| *due_ns <= end_ns) {
            self.unit.advance(due_ns, &mut self.out);
            heard.extend(self.out.take().into_iter().map(|(_, _, b)| (due_ns, b)));
        }
        self.now_ns = end_ns;
        heard
    }

    /// The one packet that answers.
    fn ask(&mut self, bytes: &[u8]) -> Packet {
        self.say(bytes);
        let heard = self.hear(100);
        assert_eq!(heard.len(), 1, "{bytes:02x?}");
        Packet::decode(&heard[0].1).unwrap()
    }
}

#[test]
fn every_command_is_answered_with_its_length() {
    let mut bench = Bench::new(Behaviour::default());
    for command in Command::ALL {
        let free = command.arguments().iter().filter(|a| **a == Argument::Free);
        // A harmless cell; continuous mode off; any calibration.
        let free: Vec<u8> = match command {
            Command::WriteEepromChecked => vec![0, 124, 1, 0xF4],
            Command::WriteEeprom => vec![124, 1, 0xF4],
            Command::SetContinuous => vec![0],
            _ => free.map(|_| 0).collect(),
        };
        bench.say(&command.request(&free).unwrap());
        let heard = bench.hear(5000);
        if *command == Command::Null {
            assert!(heard.is_empty());
            continue;
        }
        assert_eq!(heard.len(), 1, "{command}");
        assert_eq!(heard[0].1.len(), command.reply_length(), "{command}");
        if !command.is_bare() {
            assert_eq!(Packet::decode(&heard[0].1).unwrap().command(), *command);
        }
    }
    assert_eq!(bench.unit.tally().ignored_bytes, 0);
}

#[test]
fn the_forms_of_an_attitude_agree() {
    let mut bench = Bench::new(Behaviour::default());
    bench.hear(700);
    for byte in [0x04, 0x05, 0x0A, 0x0B, 0x0C, 0x0D, 0x0E, 0x12, 0x31] {
        let packet = bench.ask(&[byte]);
        let found = attitude_of::of(&packet, attitude_of::Sense::Attitude).unwrap();
        // The sample is that of the cycle's start, two or three ticks before the answer.
        let at_s = f64::from(packet.ticks().unwrap()) * 6.5536e-3;
        let wanted = [TILT[0], TILT[1], RATE_RAD_S * at_s];
        for (found, wanted) in found.iter().zip(wanted) {
            assert!(
                (found - wanted).abs() < 4e-4,
                "{byte:02x}: {found} {wanted}"
            );
        }
    }
    let gains = Gains::FACTORY;
    let packet = bench.ask(&[0x03]);
    let accel = gains.vector(&packet, Word::Accel).unwrap();
    let size = accel.iter().map(|a| a * a).sum::<f64>().sqrt();
    assert!((size - 9.81).abs() < 0.005 && accel[2] < 0.0);
    let rate = gains.vector(&packet, Word::Rate).unwrap();
    let size = rate.iter().map(|a| a * a).sum::<f64>().sqrt();
    assert!((size - RATE_RAD_S).abs() < 1e-3);
    let packet = bench.ask(&[0x07]);
    let bits = packet.word(Word::Temperature).unwrap();
    assert!((scale::temperature_deg_c(bits) - 31.0).abs() < 0.01);
}

#[test]
fn a_stream_keeps_the_cycle_of_the_tick_formula() {
    for (byte, tick, ticks) in [
        (0x03, ticks::TickFactors::FACTORY, 2),
        (0x0E, ticks::TickFactors::FACTORY, 3),
        (0x31, ticks::TickFactors([4, 10, 250, 10]), 3),
    ] {
        let behaviour = Behaviour {
            tick,
            baud: 115_200,
            first_tick: 65_500,
            clock_ppm: 50.0,
            ..Behaviour::default()
        };
        let mut bench = Bench::new(behaviour);
        bench.say(&[0x10, 0x00, byte]);
        let heard = bench.hear(3000);
        let reply = Packet::decode(&heard[0].1).unwrap();
        assert_eq!(reply.word(Word::Value(0)), Some(u16::from(byte)));
        let packets: Vec<(i64, Packet)> = heard[1..]
            .iter()
            .map(|(at, bytes)| (*at, Packet::decode(bytes).unwrap()))
            .collect();
        assert!(packets.len() > 80);
        let cycle_ns = f64::from(ticks) * tick.tick_ns() as f64 / 1.00005;
        for pair in packets.windows(2) {
            let step = pair[1]
                .1
                .ticks()
                .unwrap()
                .wrapping_sub(pair[0].1.ticks().unwrap());
            assert_eq!(i32::from(step), ticks);
            assert!(((pair[1].0 - pair[0].0) as f64 - cycle_ns).abs() < 3.0);
        }
        // The command that ends it is answered, and then there is silence.
        bench.say(&[0x10, 0x00, 0x00]);
        let heard = bench.hear(1000);
        let last = Packet::decode(&heard.last().unwrap().1).unwrap();
        assert_eq!(last.command(), Command::SetContinuous);
        assert_eq!(heard.len(), 2);
    }
}

#[test]
fn a_slow_line_holds_up_the_cycle() {
    let behaviour = Behaviour {
        baud: 19_200,
        tick: ticks::TickFactors([4, 10, 250, 2]),
        ..Behaviour::default()
    };
    let mut bench = Bench::new(behaviour);
    bench.say(&[0x10, 0x00, 0x31]);
    let heard = bench.hear(2000);
    // 23 bytes take 12 ms; three ticks of 2 ms would be 167 a second.
    let rate = (heard.len() - 1) as f64 / 2.0;
    assert!(rate > 70.0 && rate <= 83.4, "{rate}");
}

#[test]
fn a_polled_answer_comes_behind_the_streamed_packet() {
    let mut bench = Bench::new(Behaviour::default());
    bench.say(&[0x10, 0x00, 0x0E]);
    bench.hear(200);
    bench.say(&[0x03]);
    let heard = bench.hear(60);
    let headers: Vec<u8> = heard.iter().map(|(_, bytes)| bytes[0]).collect();
    let polled = headers.iter().position(|h| *h == 0x03).unwrap();
    assert_eq!(headers[polled - 1], 0x0E);
    assert_eq!(heard[polled].0, heard[polled - 1].0);
    // Sixteen at once: one goes into work, or fifteen wait, and the rest is lost.
    bench.say(&[0x07; 40]);
    let heard = bench.hear(2000);
    let answers = heard.iter().filter(|(_, bytes)| bytes[0] == 0x07).count();
    assert!((15..=16).contains(&answers), "{answers}");
    assert_eq!(bench.unit.tally().crowded_out, 40 - answers as u64);
}

#[test]
fn cells_are_read_and_written_both_ways() {
    let mut bench = Bench::new(Behaviour::default());
    let value = |packet: &Packet| packet.word(Word::Value(0)).unwrap();
    for (address, wanted) in [
        (130u8, 10_000),
        (230, 8500),
        (232, 2000),
        (44, 64),
        (246, 1),
    ] {
        assert_eq!(value(&bench.ask(&[0x28, 0, address])), wanted);
    }
    bench.say(&[0x08, 130]);
    assert_eq!(bench.hear(100)[0].1, 10_000u16.to_be_bytes());
    assert_eq!(
        value(&bench.ask(&[0x29, 0x71, 0, 124, 0x02, 0x58, 0xAA])),
        600
    );
    bench.say(&[0x09, 0x71, 126, 0x01, 0x90, 0xAA]);
    assert_eq!(bench.hear(100)[0].1, [0x01, 0x90]);
    assert_eq!(value(&bench.ask(&[0x28, 0, 124])), 600);
    assert_eq!(value(&bench.ask(&[0x28, 0, 126])), 400);
    // A wrong guard byte: no answer, nothing written. The rest of the bytes are commands of their
    // own where they are any.
    bench.say(&[0x29, 0x72]);
    assert!(bench.hear(500).is_empty());
    // A new tick acts at once, without a jump of the counter.
    let before = bench.ask(&[0x28, 0, 246]);
    let at = bench.now_ns;
    bench.ask(&[0x29, 0x71, 0, 246, 0, 4, 0xAA]);
    let after = bench.ask(&[0x28, 0, 246]);
    let passed = after.ticks().unwrap() - before.ticks().unwrap();
    assert!(
        i64::from(passed) <= (bench.now_ns - at) / 6_553_600,
        "{passed}"
    );
}

/// A tick of nothing would have it calculate without end.
#[test]
fn a_tick_that_makes_no_sense_is_the_factorys() {
    let mut bench = Bench::new(Behaviour::default());
    bench.ask(&[0x29, 0x71, 0, 246, 0, 0, 0xAA]);
    let before = bench.ask(&[0x28, 0, 246]);
    assert_eq!(before.word(Word::Value(0)), Some(0));
    bench.hear(1000);
    let after = bench.ask(&[0x28, 0, 246]);
    let passed = after.ticks().unwrap().wrapping_sub(before.ticks().unwrap());
    assert!((152..190).contains(&passed), "{passed}");
}

#[test]
fn power_up_streams_what_cell_132_says() {
    let mut bench = Bench::new(Behaviour {
        power_up: Some(Command::StabilisedEulerAccelRate),
        ..Behaviour::default()
    });
    let heard = bench.hear(500);
    assert!(heard.len() > 20 && heard.iter().all(|(_, b)| b[0] == 0x31));
    bench.say(&[0x10, 0, 0]);
    bench.hear(100);
    assert!(bench.hear(300).is_empty());
    bench.unit.restart(bench.now_ns, Duration::from_millis(200));
    let heard = bench.hear(500);
    assert!(heard[0].0 >= bench.now_ns - 300_000_000);
    assert_eq!(Packet::decode(&heard[0].1).unwrap().ticks(), Some(0));
}

#[test]
fn bias_and_tare_change_what_is_sent() {
    let mut bench = Bench::new(Behaviour::default());
    bench.say(&[0x06]);
    let heard = bench.hear(5000);
    // 500 samples, a tick each.
    assert_eq!(heard.len(), 1);
    assert!(heard[0].0 > 3_200_000_000 && heard[0].0 < 3_400_000_000);
    let packet = bench.ask(&[0x31]);
    let rate = Gains::FACTORY.vector(&packet, Word::Rate).unwrap();
    assert!(rate.iter().all(|r| r.abs() < 1e-3), "{rate:?}");
    bench.say(&[0x0F, 0xC1, 0xC3, 0xC5]);
    let tared_s = bench.hear(3000)[0].0 as f64 * 1e-9;
    let turned = |packet: &Packet| {
        let [r, p, y] = attitude_of::of(packet, attitude_of::Sense::Attitude).unwrap();
        nalgebra::UnitQuaternion::from_euler_angles(r, p, y).angle()
    };
    let packet = bench.ask(&[0x0E]);
    assert!(turned(&packet) < RATE_RAD_S * (bench.now_ns as f64 * 1e-9 - tared_s + 2.1));
    assert_eq!(
        bench.ask(&[0x11, 0xC1, 0xC3, 0xC5]).command(),
        Command::RemoveTare
    );
    let [roll, ..] = attitude_of::of(&bench.ask(&[0x0E]), attitude_of::Sense::Attitude).unwrap();
    assert!((roll - TILT[0]).abs() < 2e-4);
}

#[test]
fn any_bytes_leave_it_alive() {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let mut bench = Bench::new(Behaviour::default());
    for _ in 0..300 {
        let mut bytes = vec![0; (random.next_u32() % 40) as usize];
        random.fill_bytes(&mut bytes);
        // No writes to the EEPROM: they may set any tick or speed.
        bytes.retain(|b| !matches!(b, 0x09 | 0x29));
        bench.say(&bytes);
        bench.hear(40);
    }
    // Whatever half command is left, zeros and the end of it are understood.
    bench.say(&[0; 8]);
    bench.hear(70_000);
    bench.say(&[0x10, 0x00, 0x00]);
    let heard = bench.hear(70_000);
    let last = Packet::decode(&heard.last().unwrap().1).unwrap();
    assert_eq!(last.command(), Command::SetContinuous);
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let run = |seed| {
        let mut bench = Bench::new(Behaviour {
            noisy: true,
            seed,
            ..Behaviour::default()
        });
        bench.say(&[0x10, 0x00, 0x03]);
        bench.hear(500)
    };
    assert_eq!(run(4), run(4));
    assert_ne!(run(4), run(5));
}
