//! The toy protocol's tests, as docs/porting.md lists them: the codec against the document, the settings, the timing table of
//! the link, a node with its runner against the simulated ECU, and the simulation's reader of control frames.

use bench::by_hand::Bench;
use bench::rows::simulated;
use bench::wired::{self, LONG, control_frames, received, throttle_percent};
use embassy_time::Duration;
use sim::any::{AnyEcu, Protocol};
use sim::control::{self, Reader, Switch};
use sim::ecu::Ecu;
use sim::toy::{BadCommand, ToyCommand, ToyEcu};
use sim::wire::{Direction, Entry};
use toy::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use toy::config::{ConfigError, EngineConfig, LinkSettings, check, validate};
use toy::ecu::toy::codec::{Control, Decoder, Faults, Frame, State};
use toy::ecu::toy::config::{Config, Mistake, Service};
use toy::ecu::toy::link::ToyLink;
use toy::ecu::zk::codec::Rate;
use toy::ecu::{self as any, EcuConfig};
use toy::event::Event;
use toy::line::Line;
use toy::link::{Link, Observation, Speaks, Stage};
use toy::report::{LinkState, Phase};
use toy::setting::Effect;
use toy::units::{Celsius, Throttle};
use toy::wiring::{self, Contradiction, Ports, Wiring, WiringError};

const LINE: Line = Line::new(9600);
const ENGINE: EngineConfig = EngineConfig::new("toy", 0, LINE, EcuConfig::Toy(Config::DEFAULT));
const _: () = check(&[ENGINE]);
const RUN: Order = Order::Run(Demand::Throttle(Throttle::IDLE));

/// The simulated ECU for the row [`ENGINE`], powered up at 0. Its engine starts in a second.
fn powered() -> AnyEcu {
    let mut config = simulated(&ENGINE);
    let turbine = config.turbine_mut();
    *turbine = turbine.starting_in(1.0);
    let mut ecu = config.ecu();
    ecu.power(0, true);
    ecu
}

/// The toy ECU of a bench.
fn toy<T>(bench: &wired::Bench<AnyEcu>, look: impl FnOnce(&mut ToyEcu) -> T) -> T {
    bench.plug.ecu(|ecu| look(ecu.inner_mut().downcast_mut().expect("a toy ECU")))
}

/// The commands that it obeyed.
fn obeyed(bench: &wired::Bench<AnyEcu>) -> Vec<ToyCommand> {
    toy(bench, |ecu| ecu.commands.iter().map(|(_, command)| *command).collect())
}

fn runs(bench: &wired::Bench<AnyEcu>) -> bool {
    bench.plug.ecu(|ecu| ecu.phase().is_live())
}

fn bench() -> Bench<ToyLink> {
    Bench::new(Config::DEFAULT.link(LINE, Config::TIMING), LINE)
}

/// The document's numbers, in any chunks; numbers without a name stay known.
#[test]
fn toy_codec_has_the_numbers_of_the_document() {
    let frame =
        |state, overheated| Frame { state, faults: Faults { overheated }, egt: Celsius::from_tenths(6000) };
    for (byte, expected) in [
        (0x00, frame(State::Rest, false)),
        (0x01, frame(State::Running, false)),
        (0x81, frame(State::Running, true)),
        (0x7F, frame(State::Unknown(0x7F), false)),
    ] {
        assert_eq!(Decoder::default().feed(&[0x00, 0xA5, byte, 120, 0xA5]), (4, Some(expected)));
        let mut decoder = Decoder::default();
        assert_eq!(decoder.feed(&[0xA5]), (1, None));
        assert_eq!(decoder.feed(&[byte]), (1, None));
        assert_eq!(decoder.feed(&[120]), (1, Some(expected)));
    }
    let controls = [Control::Nothing, Control::Standby, Control::Run, Control::EmergencyStop, Control::Prime];
    assert_eq!(controls.map(Control::encode), [[0x5A, 0], [0x5A, 1], [0x5A, 2], [0x5A, 3], [0x5A, 4]]);
}

/// The table of settings has what a parameter needs, and refuses what the line cannot carry.
#[test]
fn toy_settings_have_range_default_and_effect() {
    let [row] = Config::SETTINGS else { panic!("one row") };
    assert_eq!((row.name, row.field, row.default), ("TOY_SEND_EVERY", "ecu.send_every", 100));
    assert_eq!((Config::ROWS[0].name, Config::ROWS[0].effect), (row.name, Effect::AtRest));
    assert!(ENGINE.settings().any(|setting| setting.name == row.name));
    let mut config = ENGINE;
    assert_eq!(config.set("TOY_SEND_EVERY", 20), Ok(()));
    assert_eq!(config.number("TOY_SEND_EVERY"), Some(20));
    assert_eq!(validate(&[config]), Ok(()));
    config.ecu = EcuConfig::Toy(Config { send_every: Duration::from_millis(19), ..Config::DEFAULT });
    assert_eq!(validate(&[config]).unwrap_err().message(), "ecu.send_every: 20 to 500 ms");
    let two = EngineConfig { line: Line::with_two_stop_bits(9600), ..ENGINE };
    let mistake = any::Mistake::Toy(Mistake::StopBits);
    assert_eq!(validate(&[two]), Err(ConfigError::Ecu(0, mistake)));
    assert_eq!(mistake.message(), "invalid stop bits: a toy line has one");
}

/// The wiring in RAM survives a reset with an engine of the toy, as with any other.
#[test]
fn toy_wiring_is_one_number_and_back() {
    for number in 0..=1 {
        let mut engine = ENGINE;
        engine.ecu = EcuConfig::Toy(Config { engine: number, ..Config::DEFAULT });
        let wiring = Wiring::of(&engine);
        assert_eq!((wiring.protocol, wiring.toy_engine), (next_number(), number));
        assert_eq!(Wiring::unpacked(wiring.packed()), Some(wiring));
        let mut wired = EngineConfig::zk("toy", 5, LINE, Rate::Hz20);
        wiring.apply(&mut wired);
        assert_eq!((wired.ecu, wired.timing, wired.port), (engine.ecu, engine.timing, 0));
        assert_eq!(wired.fingerprint(), engine.fingerprint());
        assert_eq!(
            wired.fingerprint() == ENGINE.fingerprint(),
            number == 0,
            "another engine's record is invalid"
        );
    }
}

/// The toy can be chosen without a compiler, and an unsupported setting is reported.
#[test]
fn toy_is_among_the_protocols_of_the_wiring() {
    let settings = Wiring::table(&Wiring::of(&ENGINE));
    let row = |name| settings.iter().find(|row| row.name == name).expect("a row of the wiring");
    assert_eq!((row("E1_PROTO").min, row("E1_PROTO").max), (1, next_number().into()));
    let text = row("E1_PROTO").text;
    assert!(text.starts_with("Protocol of the ECU. 1: AMT. 2: ZK. "), "{text}");
    assert!(text.ends_with(&format!(" {}: toy.", next_number())), "{text}");
    assert_eq!((row("E1_TOY_ENGINE").max, row("E1_TOY_ENGINE").default), (1, 0));
    let ports = Ports { count: 1, taken: None, two_stop_bits: true };
    let two = EngineConfig { line: Line::with_two_stop_bits(9600), ..ENGINE };
    assert_eq!(wiring::check(&[ENGINE], ports), Ok(()));
    assert_eq!(wiring::check(&[two], ports), Err(WiringError { row: 0, why: Contradiction::StopBits }));
}

/// Services and faults of any ECU include those of the toy.
#[test]
fn toy_services_and_faults_are_those_of_any_ecu() {
    let prime = any::Service::Toy(Service::Prime);
    assert!(prime.moves_fuel() && prime.needs_stopped_engine() && !prime.closes_pump());
    assert_eq!(prime.to_string(), "prime");
    let faults = |overheated| any::Faults::Toy(Faults { overheated });
    assert_eq!((faults(true).number(), faults(true).to_string()), (1, "overheated".into()));
    assert!(faults(false).is_empty());
}

#[test]
fn toy_link_keeps_its_timing_table() {
    let mut bench = bench();
    bench.run_to_us(150_000);
    assert_eq!(bench.frames(), [(0, vec![0x5A, 0]), (100_000, vec![0x5A, 0])], "nothing is ordered");
    bench.rx_at_us(160_000, &[0, 0xA5, 1, 120]);
    assert_ne!(bench.machine.status().state, LinkState::Up, "one frame");
    bench.rx_at_us(260_000, &[0xA5, 1, 120]);
    let status = bench.machine.status();
    assert_eq!((status.state, status.report.phase.unwrap().value), (LinkState::Up, Phase::Running));
    let observation = Observation::State { stage: Stage::Running, turning: Some(true), throttle: None };
    assert_eq!(bench.machine.take_observation(), Some(observation));
    bench.frames();
    for (order, code) in [(RUN, 2), (Order::Doubt(Demand::Throttle(Throttle::IDLE)), 0), (Order::Standby, 1)]
    {
        bench.order_at_us(bench.now_us(), order).unwrap();
        bench.run_to_us(bench.now_us() + 100_000);
        assert_eq!(bench.bytes(), [[0x5A, code]], "{order:?}");
    }
    assert_eq!(bench.order_at_us(bench.now_us(), Order::Pwm), Err(Rejected::NotSupported));
    bench.events();
    bench.run_to_us(759_999);
    assert_eq!(bench.events(), []);
    bench.run_to_us(760_000);
    assert_eq!(bench.events(), [(760_000, Event::LinkLost)]);
}

/// New settings of a link that is in use count from the next send slot and the next frame on.
#[test]
fn toy_link_takes_new_settings() {
    let mut bench = bench();
    bench.run_to_us(50_000);
    let config = Config { send_every: Duration::from_millis(20), ..Config::DEFAULT };
    bench.act(|link, now| config.configure(link, now, LINE, Config::TIMING));
    bench.run_to_us(150_000);
    let at: Vec<u64> = bench.frames().into_iter().map(|(at, _)| at).collect();
    assert_eq!(at, [0, 100_000, 120_000, 140_000]);
}

/// A node starts and stops the simulated ECU's engine, and reports its faults: runner, link and codec on a simulated line.
#[test]
fn node_starts_and_stops_a_toy_engine() {
    let bench = wired::Bench::new(&ENGINE, powered(), 1);
    let handle = bench.handle();
    let mut events = handle.events().expect("a free place");
    bench.play(LONG, async {
        bench.start().await;
        assert!(runs(&bench));
        toy(&bench, |ecu| ecu.report_overheated(true));
        bench.command_for(throttle_percent(0), Duration::from_secs(1)).await;
        let faults = any::Faults::Toy(Faults { overheated: true });
        assert_eq!(handle.telemetry().report.faults.unwrap().value, faults);
        assert!(received(&mut events).contains(&Event::Faults(faults)));
        bench.command(Command::EmergencyStop, Origin::Bench).unwrap();
        bench.until(|bench| !runs(bench)).await;
        bench.until(|bench| bench.in_phase(Phase::Standby)).await;
    });
    let mut commands = obeyed(&bench);
    commands.dedup();
    let first = [ToyCommand::Nothing, ToyCommand::Standby, ToyCommand::Run, ToyCommand::EmergencyStop];
    assert_eq!(commands, first, "the first slots are before the first command");
    assert_eq!(bench.plug.ecu(|ecu| ecu.host_faults()), [""; 0]);
}

/// What the node sends, read as the rig and the judges of random worlds read it.
#[test]
fn reader_of_the_simulation_reads_what_a_toy_node_sends() {
    let bench = wired::Bench::new(&ENGINE, powered(), 1);
    bench.plug.record(true);
    bench.play(LONG, async {
        bench.start().await;
        bench.command(Command::EmergencyStop, Origin::Bench).unwrap();
        bench.until(|bench| bench.in_phase(Phase::Standby)).await;
    });
    let frames = control_frames(Protocol::Toy, &bench.plug.log());
    let commands = || frames.iter().map(|(_, command)| *command);
    assert!(commands().eq(obeyed(&bench).into_iter().map(control::Command::Toy)));
    let mut switches: Vec<_> = commands().map(control::Command::switch).collect();
    switches.dedup();
    assert_eq!(switches, [None, Some(Switch::Standby), Some(Switch::Run), Some(Switch::Stop)]);
}

#[test]
fn reader_of_the_simulation_finds_toy_frames_after_a_part_of_one() {
    let record = Entry::delivered(Direction::ToEcu, 0, 1, &[0x5A, 0x5A, 2, 4, 0x5A, 9, 0x5A, 4]);
    let mut reader = Reader::new(Protocol::Toy);
    let found: Vec<_> = reader.read(&record).map(|frame| (frame.start, frame.command)).collect();
    let toy = |command| Ok(control::Command::Toy(command));
    let bad = Err(control::BadFrame::Toy(BadCommand::Number(9)));
    assert_eq!(found, [(1, toy(ToyCommand::Run)), (4, bad), (6, toy(ToyCommand::Prime))]);
}

/// A service command passes the engine's interlocks, and takes a send slot.
#[test]
fn node_primes_a_toy_engine_in_standby_only() {
    let prime = Command::Service(any::Service::Toy(Service::Prime));
    let bench = wired::Bench::new(&ENGINE, powered(), 1);
    let primed = || obeyed(&bench).into_iter().filter(|command| *command == ToyCommand::Prime).count();
    bench.play(LONG, async {
        bench.start().await;
        assert!(bench.command(prime, Origin::Bench).is_err());
        bench.command_for(throttle_percent(0), Duration::from_secs(1)).await;
        assert_eq!(primed(), 0);
        // It has to be cold.
        bench.command_for(Command::Standby, Duration::from_secs(60)).await;
        assert_eq!(bench.command(prime, Origin::Bench), Ok(Accepted::InForce));
        bench.command_for(Command::Standby, Duration::from_secs(1)).await;
        assert_eq!(primed(), 1);
    });
}

/// New settings of the protocol reach the link of a running node once its engine is at rest.
#[test]
fn node_takes_settings_of_the_toy_protocol_at_rest() {
    let bench = wired::Bench::new(&ENGINE, powered(), 1);
    let received = || obeyed(&bench).len();
    bench.play(LONG, async {
        bench.start().await;
        let mut config = ENGINE;
        config.set("TOY_SEND_EVERY", 20).unwrap();
        bench.channel.owner().setup().configure_link(&LinkSettings::from(&config)).unwrap();
        let before = received();
        bench.command_for(throttle_percent(0), Duration::from_secs(1)).await;
        assert_eq!(received() - before, 10, "it runs");
        bench.command_for(Command::Standby, Duration::from_secs(3)).await;
        let before = received();
        bench.command_for(Command::Standby, Duration::from_secs(1)).await;
        assert_eq!(received() - before, 50);
    });
}

fn read(name: &str) -> String {
    let path = format!("{}/../{name}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The lines of a source file without the paths of its modules.
fn lines(text: &str) -> Vec<String> {
    text.lines().filter(|line| !line.trim_start().starts_with("#[path")).map(str::to_owned).collect()
}

/// The name of the module that a line declares.
fn module(line: &str) -> Option<&str> {
    let rest = line.strip_prefix("pub ").unwrap_or(line);
    rest.strip_prefix("mod ")?.strip_suffix(';')
}

/// The number for one more protocol of the library.
fn next_number() -> u8 {
    let list = read("jetlink/src/ecu/mod.rs");
    let numbers = list.lines().filter_map(|line| {
        let (_, rest) = line.split_once(" = ")?;
        let (number, _) = rest.split_once(" \"")?;
        number.parse::<u8>().ok()
    });
    numbers.max().expect("numbers of protocols") + 1
}

/// A source file of the library or of the simulation with the toy protocol: `own` are its modules here, the paths of the others are in
/// `folder`, `row` is in its list of protocols.
fn with_toy(source: &str, own: &[&str], folder: &str, row: &str) -> String {
    let mut made = String::new();
    let mut added = false;
    for line in read(source).lines() {
        if let Some(name) = module(line) {
            if !added && name > "toy" {
                made += "pub mod toy;\n";
                added = true;
            }
            if !own.contains(&name) {
                let below = format!("{}/{name}/mod.rs", source.rsplit_once('/').unwrap().0);
                let is_folder =
                    std::fs::exists(format!("{}/../{below}", env!("CARGO_MANIFEST_DIR"))).unwrap();
                let file = if is_folder { format!("{name}/mod.rs") } else { format!("{name}.rs") };
                made += &format!("#[path = \"{folder}/{file}\"]\n");
            }
        }
        if line == "        }" {
            made += &format!("            /// The toy protocol.\n            {row}\n");
        }
        made += line;
        made.push('\n');
    }
    made
}

/// Compares a file with what is made, or writes it where `JETLINK_WRITE` is set.
fn compare(name: &str, made: &str) {
    if std::env::var_os("JETLINK_WRITE").is_some() {
        std::fs::write(format!("{}/../{name}", env!("CARGO_MANIFEST_DIR")), made).unwrap();
    } else {
        assert_eq!(read(name), made, "{name}: rewrite it with JETLINK_WRITE=1");
    }
}

/// After a new protocol of the library: `JETLINK_WRITE=1 cargo test --package toy lists_of_the_toy` rewrites them, with the toy's new number.
#[test]
fn lists_of_the_toy_are_those_of_the_library_and_the_simulation_with_one_more_protocol() {
    let row_of = |name: &str, begins: &str| {
        let text = read(name);
        let row = text.lines().find_map(|line| line.trim_start().strip_prefix(begins));
        row.unwrap_or_else(|| panic!("{name}: the toy's row")).to_owned()
    };
    let arm = row_of("toy/src/ecu/mod.rs", "Toy = ");
    let (_, arm) = arm.split_once(' ').expect("the number of the toy");
    let arm = format!("Toy = {} {arm}", next_number());
    let list = with_toy("jetlink/src/ecu/mod.rs", &[], "../../../jetlink/src/ecu", &arm);
    compare("toy/src/ecu/mod.rs", &list);

    let row = format!("Toy toy{}", row_of("toy/sim/src/protocols.rs", "Toy toy"));
    compare("toy/sim/src/protocols.rs", &with_toy("sim/src/protocols.rs", &[], "", &row));

    // Its first lines are its own.
    let simulation = read("toy/sim/src/lib.rs");
    let (begin, _) = simulation.split_once("\n#[path").expect("modules");
    let made = with_toy("sim/src/lib.rs", &["protocols"], "../../../sim/src", "");
    let (_, modules) = made.split_once("\n#[path").expect("modules");
    compare("toy/sim/src/lib.rs", &format!("{begin}\n#[path{modules}"));
}

/// docs/porting.md says what a new protocol needs in the library: its folder and two lines in `ecu/mod.rs`; and in the simulation: its
/// folder, a `mod` line, and a line in `protocols.rs`. All other files are their own.
#[test]
fn toy_protocol_takes_a_folder_and_two_lines() {
    let (toys, librarys) = (lines(&read("toy/src/ecu/mod.rs")), lines(&read("jetlink/src/ecu/mod.rs")));
    let added: Vec<&str> =
        toys.iter().filter(|line| !librarys.contains(line)).map(|line| line.trim_start()).collect();
    let [module, doc, arm] = added[..] else { panic!("{added:#?}") };
    assert_eq!((module, doc), ("pub mod toy;", "/// The toy protocol."));
    let begin = format!("Toy = {} \"toy\" ($crate::ecu::toy::config::Config, ", next_number());
    assert!(arm.starts_with(&begin), "{arm}");
    let without: Vec<&String> = toys.iter().filter(|line| !added.contains(&line.trim_start())).collect();
    assert_eq!(without, librarys.iter().collect::<Vec<_>>());

    let (table, simulated) = (lines(&read("sim/src/protocols.rs")), lines(&read("toy/sim/src/protocols.rs")));
    let added: Vec<&String> = simulated.iter().filter(|line| !table.contains(line)).collect();
    let [doc, row] = added[..] else { panic!("{added:#?}") };
    assert_eq!(doc.trim_start(), "/// The toy protocol.");
    assert!(row.trim_start().starts_with("Toy toy($crate::toy::ToyConfig, "), "{row}");
    assert!(simulated.iter().filter(|line| !added.contains(line)).eq(&table));

    let modules = |name: &str| -> Vec<String> {
        let mut modules = lines(&read(name));
        modules.retain(|line| line.contains("mod ") && line.ends_with(';'));
        modules.sort();
        modules
    };
    assert_eq!(modules("toy/src/lib.rs"), modules("jetlink/src/lib.rs"));
    let mut simulation = modules("toy/sim/src/lib.rs");
    simulation.retain(|line| line != "pub mod toy;");
    assert_eq!(simulation, modules("sim/src/lib.rs"));
}

/// The files that docs/porting.md names for a protocol are there for AMT, and so are those that it does not name by vendor.
#[test]
fn files_that_the_page_names_for_a_protocol_exist() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let page = std::fs::read_to_string(format!("{root}/docs/porting.md")).unwrap();
    let (_, section) = page.split_once("## A new ECU protocol").unwrap();
    let (section, _) = section.split_once("\n## ").unwrap();
    let quoted = section.split('`').skip(1).step_by(2);
    let paths: Vec<String> =
        quoted.filter(|text| text.contains('/')).map(|text| text.replace("<vendor>", "amt")).collect();
    let exists = |path: &str| std::fs::exists(format!("{root}/{path}")).unwrap();
    let missing: Vec<&String> = paths.iter().filter(|path| !exists(path)).collect();
    assert!(paths.len() > 25 && missing.is_empty(), "{} paths, missing: {missing:?}", paths.len());
    assert!(!exists("sim/src/vendor/mod.rs"), "and others do not");
}
