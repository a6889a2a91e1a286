//! Requests and answers of the command plane, and messages of the console's pages.

use std::sync::LazyLock;

use ipc_types::{
    CommandService, EXPERIMENT_COMMANDS, ExperimentAnswer, ExperimentRequest, LOGGER_COMMANDS,
    LoggerAnswer, LoggerRequest, PulseSource, SIMULATOR_COMMANDS, SimulatorAnswer,
    SimulatorRequest, Verb, VerbAnswer, WATCHDOG_COMMANDS, WatchdogState,
};
use runtime::request::{decode, encode};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{Outcome, chosen, texts};

/// Decodes a message; it is encoded and decoded again as the same.
fn coded<M: Serialize + DeserializeOwned>(
    service: &CommandService,
    bytes: &[u8],
) -> Result<M, String> {
    let message: M = decode(service.name, bytes).map_err(|error| error.to_string())?;
    // What came in a longer form than needed may be too long to be sent on, never the reverse.
    let again = encode(service, &message).map_err(|error| error.to_string())?;
    let same: M = decode(service.name, &again).map_err(|error| error.to_string())?;
    let twice = encode(service, &same).map_err(|error| error.to_string())?;
    assert!(again == twice, "it changes when it is passed on");
    Ok(message)
}

/// The first byte chooses the type.
pub(crate) fn read(bytes: &[u8]) -> Outcome {
    let (way, bytes) = chosen(bytes, 8);
    match way {
        0 => asked_of_the_experiment(coded(&EXPERIMENT_COMMANDS, bytes)?),
        1 => asked_of_the_simulator(coded(&SIMULATOR_COMMANDS, bytes)?),
        2 => coded::<LoggerRequest>(&LOGGER_COMMANDS, bytes).map(drop),
        3 => coded::<Verb>(&WATCHDOG_COMMANDS, bytes).map(drop),
        4 => coded::<ExperimentAnswer>(&EXPERIMENT_COMMANDS, bytes).map(|answer| {
            let _shown = (answer.scan.map(|scan| scan.to_string()), answer.sessions.as_ref())
                .1
                .map(ToString::to_string);
        }),
        5 => coded::<SimulatorAnswer>(&SIMULATOR_COMMANDS, bytes)
            .map(|answer| drop(answer.faults.iter().map(ToString::to_string).collect::<String>())),
        6 => coded::<LoggerAnswer>(&LOGGER_COMMANDS, bytes).map(drop),
        _ => coded::<VerbAnswer>(&WATCHDOG_COMMANDS, bytes).map(drop),
    }
}

fn asked_of_the_experiment(request: ExperimentRequest) -> Outcome {
    let (ExperimentRequest::Check { protocol, name, pulses }
    | ExperimentRequest::Run { protocol, name, pulses, .. }) = request
    else {
        return Ok(());
    };
    let pulses = experiment::scan_plan::Pulses::of(&pulses);
    let protocol = rig::protocol::Protocol::parse(&protocol, &name);
    pulses.and(protocol.map(drop).map_err(|error| error.to_string()))
}

fn asked_of_the_simulator(request: SimulatorRequest) -> Outcome {
    match request {
        SimulatorRequest::Effects { effects } => {
            let made = effects.iter().map(|effect| plant::effects::parse(effect).map(drop));
            made.collect::<Result<(), _>>().map_err(|error| error.to_string())
        }
        SimulatorRequest::Fault { fault, axis, for_s } => {
            texts::fault(&fault, axis.as_deref(), for_s)
        }
        SimulatorRequest::ClearFaults { fault, axis } => {
            texts::fault_filter(fault.as_deref(), axis.as_deref())
        }
        SimulatorRequest::Status => Ok(()),
    }
}

fn seed(way: u8, service: &CommandService, message: &impl Serialize) -> Vec<u8> {
    [vec![way], encode(service, message).expect("it fits")].concat()
}

pub(crate) fn seeds() -> Vec<Vec<u8>> {
    let pulses = || "2,jitter=0.001,missing=3,spurious=4.5".parse().expect("an emulated scanner");
    let text = |name: &str| {
        let shipped = rig::PROTOCOLS.iter().find(|shipped| shipped.name == name);
        shipped.map_or_else(String::new, |shipped| shipped.text.to_owned())
    };
    let name = || "guided-1hz.toml".to_owned();
    let pairs = || vec![("protocol".to_owned(), "home".to_owned()), (String::new(), String::new())];
    let experiment = [
        ExperimentRequest::Check { protocol: text("home"), name: name(), pulses: pulses() },
        ExperimentRequest::Run {
            protocol: text("guided-1hz"),
            name: name(),
            client: u64::MAX,
            pulses: PulseSource::Key,
        },
        ExperimentRequest::Pulse { client: 3, at_ns: 1 << 40 },
        ExperimentRequest::Renew { client: 3 },
        ExperimentRequest::Interrupted,
        ExperimentRequest::Continue { client: 3, protocol: u64::MAX, segment: 7 },
        ExperimentRequest::Stop { client: Some(1) },
        ExperimentRequest::Status,
    ];
    let simulator = [
        SimulatorRequest::Effects { effects: vec!["backlash@slave=0.05".to_owned()] },
        SimulatorRequest::Fault {
            fault: "encoder_stuck@master".to_owned(),
            axis: Some("0".to_owned()),
            for_s: Some(0.5),
        },
        SimulatorRequest::ClearFaults { fault: Some("adc_rail".to_owned()), axis: None },
        SimulatorRequest::Status,
    ];
    let logger = [
        LoggerRequest::Start {
            path: "/data/run.mcap".to_owned(),
            metadata: pairs(),
            split: ipc_types::Split { every_ns: Some(600_000_000_000), ..Default::default() },
        },
        LoggerRequest::Stop,
        LoggerRequest::NextPart,
        LoggerRequest::Run { metadata: pairs() },
        LoggerRequest::Tag { author: "anna".to_owned(), text: "elbow moved".to_owned() },
    ];
    let answer = ExperimentAnswer {
        scan: Some(ipc_types::ScanProgress { volumes: 3, missed: 1, ..Default::default() }),
        sessions: Some(ipc_types::SessionProgress {
            over: 1,
            sessions: 4,
            target: Some(vec![0.25, 0.5]),
        }),
        interrupted: Some(ipc_types::InterruptedRun { pulses: pulses(), ..Default::default() }),
        ..ExperimentAnswer::default()
    };
    let fault = ipc_types::InjectedFault { until_tick: Some(9), ..Default::default() };
    let faults = SimulatorAnswer { faults: vec![fault], ..SimulatorAnswer::default() };
    let verb = VerbAnswer { done: false, state: WatchdogState::Tripped, reason: "x".to_owned() };
    let mut seeds = Vec::new();
    seeds.extend(experiment.iter().map(|message| seed(0, &EXPERIMENT_COMMANDS, message)));
    seeds.extend(simulator.iter().map(|message| seed(1, &SIMULATOR_COMMANDS, message)));
    seeds.extend(logger.iter().map(|message| seed(2, &LOGGER_COMMANDS, message)));
    seeds.extend(Verb::ALL.iter().map(|verb| seed(3, &WATCHDOG_COMMANDS, verb)));
    seeds.push(seed(4, &EXPERIMENT_COMMANDS, &answer));
    seeds.push(seed(5, &SIMULATOR_COMMANDS, &faults));
    seeds.push(seed(6, &LOGGER_COMMANDS, &LoggerAnswer::default()));
    seeds.push(seed(7, &WATCHDOG_COMMANDS, &verb));
    seeds
}

/// A message of a console's page.
pub(crate) fn page(bytes: &[u8]) -> Outcome {
    let text = String::from_utf8_lossy(bytes);
    web_console::check_message(&text).map(drop).map_err(|(_, told)| told)
}

static PAGE: LazyLock<Vec<String>> = LazyLock::new(|| {
    let requests = [
        r#"{"do":"hello","token":"6f1c"}"#,
        r#"{"do":"take-control"}"#,
        r#"{"do":"verb","verb":"estop"}"#,
        r#"{"do":"describe","protocol":"guided-1hz"}"#,
        r#"{"do":"build","protocol":"steps","entries":{"a.b":"1"},"subject":"S07","scanner":"2"}"#,
        r#"{"do":"build","protocol":"x","scanner":"2,jitter=0.001,missing=3","files":"S07_"}"#,
        r#"{"do":"interrupted","subject":"S07","files":""}"#,
        r#"{"do":"initialise"}"#,
        r#"{"do":"start","build":"0000000000000000"}"#,
        r#"{"do":"stop"}"#,
        r#"{"do":"pulse","page_ms":1.5}"#,
        r#"{"do":"note","text":"subject moved"}"#,
        r#"{"do":"record","file":"/data/S07.mcap"}"#,
        r#"{"do":"end-recording"}"#,
        r#"{"do":"refresh"}"#,
        r#"{"do":"echo","server_ms":1.0,"page_ms":2.0}"#,
        r#"{"do":"shown","at_ms":1.0,"page_ms":2.0}"#,
        r#"{"do":"sounded","event":"session begun","at_ms":1.0,"page_ms":2.0}"#,
    ];
    requests.iter().map(|request| format!("{{\"id\":7,\"request\":{request}}}")).collect()
});

pub(crate) fn page_seeds() -> Vec<Vec<u8>> {
    PAGE.iter().map(|text| text.clone().into_bytes()).collect()
}

/// A request of a bridge's viewer.
pub(crate) fn viewer(bytes: &[u8]) -> Outcome {
    bridge::check_request(&String::from_utf8_lossy(bytes)).map(drop)
}

pub(crate) fn viewer_seeds() -> Vec<Vec<u8>> {
    let requests = [
        r#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":1},{"id":8,"channelId":2}]}"#,
        r#"{"op":"unsubscribe","subscriptionIds":[7,8]}"#,
        r#"{"op":"advertise","channels":[{"id":1,"topic":"x","encoding":"json"}]}"#,
    ];
    requests.iter().map(|text| text.as_bytes().to_vec()).collect()
}
