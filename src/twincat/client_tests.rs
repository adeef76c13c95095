//! The client, the questions for symbols and the writing of variables, against an emulated PLC.

use super::*;
use crate::link::emulation::Conditions;
use crate::link::faults::Faults;
use crate::link::waker;
use crate::twincat::ams::{Transmission, index};
use crate::twincat::emulator::{Plc, Service, SharedPlc};
use crate::twincat::fields::{USUAL, parse_fields};
use crate::twincat::image::{Image, Missing, Variable, Wanted};
use crate::twincat::symbols;
use crate::twincat::variables::{self, Handles, VariableError};

/// As long as anything may take on a busy machine.
const LONG: Duration = Duration::from_secs(20);
const SHORT: Duration = Duration::from_millis(30);

fn serve(plc: Plc, conditions: Conditions) -> (SharedPlc, Service, Client) {
    let plc = SharedPlc::new(plc);
    let service = Service::start(&plc, ([127, 0, 0, 1], 0).into(), conditions).unwrap();
    let client = connect(&plc, &service, LocalAddress::Usual).unwrap();
    (plc, service, client)
}

fn connect(plc: &SharedPlc, service: &Service, local: LocalAddress) -> Result<Client, ClientError> {
    let target: Target = service.target(plc).parse().unwrap();
    Client::connect(&target, local, LONG)
}

fn image(wanted: &[&str], variables: &[Variable], fields: &str) -> Image {
    let wanted: Vec<Wanted> = wanted.iter().map(|w| w.parse().unwrap()).collect();
    let fields = parse_fields(fields).unwrap();
    let given = wanted
        .iter()
        .all(|w| w.field.is_none())
        .then_some(&fields[..]);
    Image::plan(&wanted, variables, given, &fields, Missing::Hold).unwrap()
}

fn sick_value(client: &mut Client) -> Handles {
    let (_, variable) = variables::find(client, "MAIN.SickValue", None, LONG).unwrap();
    let image = image(&["MAIN.SickValue"], &[variable], USUAL);
    Handles::get(client, &image, LONG).unwrap()
}

fn bytes(numbers: [f64; 9]) -> Vec<u8> {
    numbers
        .iter()
        .flat_map(|number| number.to_le_bytes())
        .collect()
}

#[test]
fn a_value_is_written_and_read_back() {
    let (plc, _service, mut client) = serve(Plc::with_sick_value(), Conditions::default());
    assert_eq!(client.source().net_id.to_string(), "127.0.0.1.1.1");
    assert_eq!(client.device_info(LONG).unwrap(), "Plc30 App 3.1.4026");
    let state = client.state(LONG).unwrap();
    assert!(state.runs() && state.name() == "RUN");
    let mut handles = sick_value(&mut client);
    let numbers = [
        0.1,
        -2.0,
        f64::MIN_POSITIVE,
        3.5,
        f64::MAX,
        -0.0,
        1e300,
        7.0,
        9.0,
    ];
    handles.write(&mut client, &bytes(numbers), LONG).unwrap();
    assert_eq!(plc.lock().lreals("MAIN.SickValue"), numbers);
    let (handle, size) = handles.single().unwrap();
    let back = client
        .read(index::VALUE_BY_HANDLE, handle, size, LONG)
        .unwrap();
    assert_eq!(back, bytes(numbers));
    let short = handles.write(&mut client, &[0; 64], LONG);
    assert_eq!(short.unwrap_err().code(), Some(Code::SIZE));
    handles.release(&mut client, LONG);
    let gone = handles
        .write(&mut client, &bytes(numbers), LONG)
        .unwrap_err();
    assert!(gone.code().unwrap().is_stale_handle() && !gone.is_fatal());
    assert_eq!(plc.lock().writes("MAIN.SickValue"), 1);
    assert_eq!(client.counts(), Counts::default());
}

#[test]
fn a_late_answer_is_dropped_and_the_next_ones_fit() {
    let (plc, _service, mut client) = serve(Plc::with_sick_value(), Conditions::default());
    let mut handles = sick_value(&mut client);
    {
        let mut plc = plc.lock();
        plc.trouble.late = 1;
        plc.trouble.late_ns = 120_000_000;
    }
    let late = handles.write(&mut client, &bytes([1.0; 9]), SHORT);
    assert!(matches!(late, Err(ClientError::Timeout { .. })));
    // The next one is answered before the late one is, and it is its own answer.
    let refused = client.read(index::VALUE_BY_HANDLE, 1, 8, LONG).unwrap_err();
    assert_eq!(refused.code(), Some(Code::OLD_SYMBOL));
    let due = Instant::now() + LONG;
    let mut number = 2.0;
    while client.counts().late == 0 && Instant::now() < due {
        handles
            .write(&mut client, &bytes([number; 9]), LONG)
            .unwrap();
        assert_eq!(plc.lock().lreals("MAIN.SickValue"), [number; 9]);
        number += 1.0;
    }
    assert_eq!(client.counts().late, 1);
}

#[test]
fn answers_in_pieces_of_a_byte() {
    let faults: Faults = "chunk=1".parse().unwrap();
    let conditions = Conditions {
        faults,
        ..Conditions::default()
    };
    let (plc, _service, mut client) = serve(Plc::with_sick_value(), conditions);
    let mut handles = sick_value(&mut client);
    for number in 0..20 {
        handles
            .write(&mut client, &bytes([f64::from(number); 9]), LONG)
            .unwrap();
    }
    assert_eq!(plc.lock().writes("MAIN.SickValue"), 20);
}

#[test]
fn several_variables_in_one_request() {
    let mut plc = Plc::default();
    for (name, of) in [
        ("MAIN.fX", "LREAL"),
        ("MAIN.n", "UDINT"),
        ("MAIN.b", "BOOL"),
    ] {
        assert!(plc.declare(name, of));
    }
    let (plc, _service, mut client) = serve(plc, Conditions::default());
    let wanted = ["MAIN.fX=x", "MAIN.n=status", "MAIN.b=valid"];
    let names = ["MAIN.fX", "MAIN.n", "MAIN.b"];
    let variables = names.map(|name| variables::find(&mut client, name, None, LONG).unwrap().1);
    let image = image(&wanted, &variables, USUAL);
    let mut handles = Handles::get(&mut client, &image, LONG).unwrap();
    let value = [&2.5f64.to_le_bytes()[..], &[1, 2, 3, 4, 1]].concat();
    let before = plc.lock().requests;
    handles.write(&mut client, &value, LONG).unwrap();
    assert_eq!(plc.lock().requests, before + 1);
    assert_eq!(plc.lock().find("main.N").unwrap().value, [1, 2, 3, 4]);
    plc.lock().trouble.item = Some((1, Code::DENIED));
    let denied = handles.write(&mut client, &value, LONG).unwrap_err();
    assert_eq!(denied.code(), Some(Code::DENIED));
    handles.write(&mut client, &value, LONG).unwrap();
    plc.lock().trouble.unknown_groups.push(index::SUM_WRITE);
    let unknown = handles.write(&mut client, &value, LONG).unwrap_err();
    assert_eq!(unknown.code(), Some(Code::NO_GROUP));
}

#[test]
fn what_the_controller_says_of_variables() {
    let mut plc = Plc::with_sick_value();
    let members = [
        ("x", "LREAL"),
        ("bOk", "BOOL"),
        ("nSeq", "UDINT"),
        ("a", "ARRAY [1..2] OF INT"),
    ];
    assert!(plc.declare_struct("ST_Pose", &members));
    assert!(plc.declare("GVL.stPose", "ST_Pose"));
    assert!(plc.declare("GVL.nShort", "INT"));
    plc.set_read_only("GVL.nShort");
    let (plc, _service, mut client) = serve(plc, Conditions::default());
    let all = symbols::all(&mut client, LONG).unwrap();
    let names: Vec<&str> = all.iter().map(|symbol| symbol.name.as_str()).collect();
    assert_eq!(names, ["MAIN.SickValue", "GVL.stPose", "GVL.nShort"]);
    let (_, variable) = variables::find(&mut client, "GVL.stPose", None, LONG).unwrap();
    assert_eq!(
        variable.layout.to_string(),
        "x: LREAL, bOk: BOOL, nSeq: UDINT, a[1]: INT, a[2]: INT (24 bytes)"
    );
    assert_eq!(variable.layout.slots[2].offset, 12);
    let missing = variables::find(&mut client, "MAIN.NoSuch", None, LONG);
    assert!(matches!(missing, Err(VariableError::NotFound { .. })));
    // A controller that tells sizes only.
    plc.lock()
        .trouble
        .unknown_groups
        .push(index::INFO_BY_NAME_EX);
    let (_, variable) = variables::find(&mut client, "MAIN.SickValue", None, LONG).unwrap();
    assert_eq!(variable.layout.to_string(), "9 LREAL (72 bytes)");
    let unknown = variables::find(&mut client, "GVL.nShort", None, LONG).unwrap_err();
    assert!(unknown.to_string().contains("--layout"), "{unknown}");
    let layout = "INT".parse().unwrap();
    assert!(variables::find(&mut client, "GVL.nShort", Some(&layout), LONG).is_ok());
    let layout = "DINT".parse().unwrap();
    let unfit = variables::find(&mut client, "GVL.nShort", Some(&layout), LONG).unwrap_err();
    assert!(unfit.to_string().contains("2 bytes"), "{unfit}");
}

#[test]
fn a_router_gives_a_port() {
    let plc = SharedPlc::new(Plc::with_sick_value());
    let service = Service::start(&plc, ([127, 0, 0, 1], 0).into(), Conditions::default()).unwrap();
    let mut ports = Vec::new();
    for _ in 0..2 {
        let mut client = connect(&plc, &service, LocalAddress::Router).unwrap();
        assert_eq!(client.source().net_id, plc.lock().net_id);
        assert!(client.state(LONG).unwrap().runs());
        ports.push(client.source().port);
        client.close();
    }
    assert_eq!(ports, [0x8001, 0x8002]);
    let given = LocalAddress::NetId(NetId([1, 2, 3, 4, 5, 6]));
    let client = connect(&plc, &service, given).unwrap();
    assert_eq!(client.source().net_id, NetId([1, 2, 3, 4, 5, 6]));
}

#[test]
fn who_is_not_there_is_named() {
    let (plc, _service, mut client) = serve(Plc::with_sick_value(), Conditions::default());
    plc.lock().trouble.port_closed = true;
    assert_eq!(client.state(LONG).unwrap_err().code(), Some(Code::NO_PORT));
    plc.lock().net_id = NetId([9; 6]);
    assert_eq!(
        client.state(LONG).unwrap_err().code(),
        Some(Code::NO_MACHINE)
    );
    plc.lock().trouble.mute = true;
    assert!(matches!(
        client.state(SHORT),
        Err(ClientError::Timeout { .. })
    ));
    plc.lock().trouble.mute = false;
    plc.lock().trouble.no_route = true;
    assert!(client.state(LONG).unwrap_err().is_fatal());
}

#[test]
fn garbage_ends_the_connection() {
    let (plc, _service, mut client) = serve(Plc::with_sick_value(), Conditions::default());
    plc.lock().trouble.garbage = Some(b"HTTP/1.1 400 Bad Request\r\n".to_vec());
    let error = client.state(LONG).unwrap_err();
    assert!(matches!(error, ClientError::Frame(_)) && error.is_fatal());
    let (plc, _service, mut client) = serve(Plc::with_sick_value(), Conditions::default());
    plc.lock().trouble.garbage = Some(vec![0, 0, 0xFF, 0xFF, 0xFF, 0xFF]);
    assert!(client.state(LONG).unwrap_err().is_fatal());
}

#[test]
fn a_newer_connection_of_the_same_host_ends_the_older() {
    let (plc, service, mut older) = serve(Plc::with_sick_value(), Conditions::default());
    assert!(older.state(LONG).is_ok());
    plc.lock().trouble.one_connection = true;
    let mut newer = connect(&plc, &service, LocalAddress::Usual).unwrap();
    assert!(newer.state(LONG).is_ok());
    assert!(older.state(LONG).unwrap_err().is_fatal());
    assert!(newer.state(LONG).is_ok());
}

#[test]
fn notifications_come_beside_writes() {
    let mut plc = Plc::with_sick_value();
    assert!(plc.declare("GVL.fDesired", "LREAL"));
    let (plc, _service, mut client) = serve(plc, Conditions::default());
    let mut handles = sick_value(&mut client);
    let symbol = symbols::find(&mut client, "GVL.fDesired", LONG).unwrap();
    let request = Request::AddNotification {
        group: symbol.group,
        offset: symbol.offset,
        length: symbol.size,
        mode: Transmission::Cyclic,
        max_delay: 0,
        cycle: 10_000,
    };
    let reply = client.call(&request, LONG, |payload| Bytes(payload).u32());
    let handle = reply.unwrap().unwrap();
    let (waker, waiter) = waker().unwrap();
    let (mut seen, mut number) = (0, 0.0f64);
    let due = Instant::now() + LONG;
    while seen < 20 && Instant::now() < due {
        number += 1.0;
        plc.lock().set("GVL.fDesired", &number.to_le_bytes());
        handles
            .write(&mut client, &bytes([number; 9]), LONG)
            .unwrap();
        client.wait(&waiter, Duration::from_millis(5)).unwrap();
        while let Some((notified, _)) = client.notified() {
            assert_eq!((notified.handle, notified.data.len()), (handle, 8));
            let stamp = crate::twincat::fields::filetime(notified.filetime);
            assert!((HostInstant::now().utc - stamp).abs() < 60_000_000_000);
            seen += 1;
        }
    }
    // Several may have come at once.
    assert!(seen >= 20, "{seen} notifications");
    let request = Request::DeleteNotification { handle };
    client.call(&request, LONG, |_| ()).unwrap();
    let again = client.call(&request, LONG, |_| ()).unwrap_err();
    assert_eq!(again.code(), Some(Code::NO_NOTIFICATION));
    drop(waker);
}

#[test]
fn a_question_may_be_left_open() {
    let (_plc, _service, mut client) = serve(Plc::with_sick_value(), Conditions::default());
    let mut handles = sick_value(&mut client);
    let version = Request::Read {
        group: index::SYMBOL_VERSION,
        offset: 0,
        length: 1,
    };
    let id = client.send(&version, LONG).unwrap();
    // The write's own answer comes behind that of the question.
    handles.write(&mut client, &bytes([1.0; 9]), LONG).unwrap();
    let answer = client.answer(id).unwrap().unwrap();
    assert_eq!(answer, [1, 0, 0, 0, 1]);
    assert!(client.answer(id).is_none());
}
