//! The drawing of the wiring, docs/wiring.svg: its side of the board is made from the table. `JETLINK_WRITE=1 cargo test -p
//! boards` rewrites it.

use boards::{BOARDS, Board};
use std::fmt::Write;
use std::path::Path;

/// The part of the drawing that does not depend on the boards.
const TITLE: &str = "Wiring: signals, not connectors. Not tried on hardware.";
const MANUAL: &str = "pins: your ECU's manual";

const WIDTH: u32 = 1200;
/// The boxes: the board's right side, the transceiver's sides, the ECU's left side.
const BOARD_RIGHT: u32 = 300;
const CONVERTER: (u32, u32) = (460, 790);
const ECU_LEFT: u32 = 900;
/// Between two signals.
const ROW: u32 = 46;
/// A line of the list of ports.
const LINE: u32 = 20;

/// The colours of a drawing: ground, ink, thin ink, wires, what warns.
struct Colours([&'static str; 5]);

const LIGHT: Colours = Colours(["#ffffff", "#1f2328", "#59636e", "#0550ae", "#a40e26"]);
const DARK: Colours = Colours(["#0d1117", "#e6edf3", "#9198a1", "#79c0ff", "#ff7b72"]);

struct Svg {
    text: String,
    colours: Colours,
}

impl Svg {
    fn text(&mut self, x: u32, y: u32, size: u32, anchor: &str, colour: usize, text: &str) {
        let colour = self.colours.0[colour];
        let text = text.replace('&', "&amp;").replace('<', "&lt;");
        writeln!(
            self.text,
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{text}</text>"
        )
        .expect("a string");
    }

    fn rect(&mut self, (x, y): (u32, u32), (width, height): (u32, u32)) {
        let [ground, ink, ..] = self.colours.0;
        writeln!(
            self.text,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" rx=\"4\" fill=\"{ground}\" stroke=\"{ink}\" \
             stroke-width=\"2\"/>"
        )
        .expect("a string");
    }

    fn wire(&mut self, from: (u32, u32), to: (u32, u32)) {
        let [_, _, _, wire, _] = self.colours.0;
        writeln!(
            self.text,
            "<path d=\"M{} {}L{} {}\" stroke=\"{wire}\" stroke-width=\"2.5\"/>",
            from.0, from.1, to.0, to.1
        )
        .expect("a string");
    }

    /// A wire that goes one way, with its arrow in the middle.
    fn signal(&mut self, from: (u32, u32), to: (u32, u32)) {
        self.wire(from, to);
        let [_, _, _, wire, _] = self.colours.0;
        let (middle, tip) = (from.0.midpoint(to.0), if to.0 > from.0 { 12 } else { -12 });
        writeln!(
            self.text,
            "<path d=\"M{middle} {y}m{tip} 0l{back} -6v12z\" fill=\"{wire}\"/>",
            y = from.1,
            back = -tip
        )
        .expect("a string");
    }

    /// From 3.3 V to TX, at the board.
    fn pull_up(&mut self, y: u32) {
        let x = BOARD_RIGHT + 70;
        self.wire((x, y), (x, y + ROW));
        self.rect((x - 8, y + 8), (16, ROW - 16));
        self.text(x + 16, y + ROW / 2 + 5, 15, "start", 1, "10 kΩ");
    }

    /// The board's side, from this height on.
    fn board(&mut self, y: u32) {
        self.rect((40, y - 50), (BOARD_RIGHT - 40, 3 * ROW + 90));
        self.text(56, y - 24, 17, "start", 1, "jetlink's board, an ECU port");
        for (row, signal) in ["3.3 V", "TX, 3.3 V logic", "RX, 3.3 V logic", "ground"].into_iter().enumerate()
        {
            self.text(BOARD_RIGHT - 12, y + ROW * row as u32 + 5, 16, "end", 1, signal);
        }
        self.text(56, y + 3 * ROW + 28, 14, "start", 2, "pads and pins: the list below");
    }

    /// The ECU's side: signals and level, never pins.
    fn ecu(&mut self, y: u32, name: &str, level: &str) {
        self.rect((ECU_LEFT, y - 50), (WIDTH - 40 - ECU_LEFT, 3 * ROW + 90));
        self.text(ECU_LEFT + 16, y - 24, 17, "start", 1, name);
        self.text(ECU_LEFT + 16, y + 5, 14, "start", 2, level);
        for (row, signal) in ["RX", "TX", "ground"].into_iter().enumerate() {
            self.text(ECU_LEFT + 12, y + ROW * (row as u32 + 1) + 5, 16, "start", 1, signal);
        }
        self.text(ECU_LEFT + 16, y + 3 * ROW + 28, 14, "start", 4, MANUAL);
    }

    /// An output, what it drives, and the valve.
    fn valve(&mut self, y: u32) {
        self.rect((40, y - 50), (BOARD_RIGHT - 40, 3 * ROW + 90));
        self.text(56, y - 24, 17, "start", 1, "jetlink's board, an output");
        for (row, signal) in ["3.3 V, a few mA", "ground"].into_iter().enumerate() {
            self.text(BOARD_RIGHT - 12, y + 2 * ROW * row as u32 + 5, 16, "end", 1, signal);
        }
        // To ground, this level would energise.
        self.text(56, y + 3 * ROW + 5, 14, "start", 4, "OutputPin::low: 10 kΩ to 3.3 V");
        self.text(56, y + 3 * ROW + 28, 14, "start", 2, "pins: docs/boards.md");
        self.signal((BOARD_RIGHT, y), (CONVERTER.0, y));
        self.wire((BOARD_RIGHT, y + 2 * ROW), (CONVERTER.0, y + 2 * ROW));
        // The level that energises nothing, while the pin floats.
        let x = BOARD_RIGHT + 70;
        self.wire((x, y), (x, y + 2 * ROW));
        self.rect((x - 8, y + 18), (16, 2 * ROW - 36));
        self.text(x + 16, y + ROW + 5, 15, "start", 1, "10 kΩ");
        self.rect((CONVERTER.0, y - 50), (CONVERTER.1 - CONVERTER.0, 3 * ROW + 90));
        self.text(CONVERTER.0 + 16, y - 24, 17, "start", 1, "driver and relay, not latching");
        let lines = [
            "driver: transistor for the coil",
            "a diode across the coil",
            "off delay: 7 s; plain image: 0.1 s",
        ];
        for (row, line) in lines.into_iter().enumerate() {
            self.text(CONVERTER.0 + 16, y + ROW * row as u32 + 24, 15, "start", 1, line);
        }
        self.text(CONVERTER.0 + 16, y + 3 * ROW + 28, 14, "start", 4, "without it a reset is a flame-out");
        self.signal((CONVERTER.1, y + ROW), (ECU_LEFT, y + ROW));
        self.wire((CONVERTER.1, y + 2 * ROW), (ECU_LEFT, y + 2 * ROW));
        self.rect((ECU_LEFT, y - 50), (WIDTH - 40 - ECU_LEFT, 3 * ROW + 90));
        self.text(ECU_LEFT + 16, y - 24, 17, "start", 1, "fuel valve");
        self.text(ECU_LEFT + 16, y + 5, 14, "start", 2, "in the fuel line, before the pump");
        for (row, line) in ["supply", "ground"].into_iter().enumerate() {
            self.text(ECU_LEFT + 12, y + ROW * (row as u32 + 1) + 5, 16, "start", 1, line);
        }
        self.text(ECU_LEFT + 16, y + 3 * ROW + 28, 14, "start", 4, "closed without power");
    }

    /// A receiver of radio control: its signal comes in, and nothing goes out to it.
    fn receiver(&mut self, y: u32) {
        self.rect((40, y - 50), (BOARD_RIGHT - 40, 2 * ROW + 90));
        self.text(56, y - 24, 17, "start", 1, "jetlink's board");
        self.rect((ECU_LEFT, y - 50), (WIDTH - 40 - ECU_LEFT, 2 * ROW + 90));
        self.text(ECU_LEFT + 16, y - 24, 17, "start", 1, "receiver");
        for (row, (board, receiver)) in
            [("RX of a port, or an input for pulses", "signal, 3.3 V"), ("ground", "ground")]
                .into_iter()
                .enumerate()
        {
            let y = y + ROW * row as u32;
            self.text(BOARD_RIGHT - 12, y + 5, if row == 0 { 13 } else { 16 }, "end", 1, board);
            self.text(ECU_LEFT + 12, y + 5, 16, "start", 1, receiver);
        }
        self.signal((ECU_LEFT, y), (BOARD_RIGHT, y));
        self.wire((ECU_LEFT, y + ROW), (BOARD_RIGHT, y + ROW));
        self.text(56, y + 2 * ROW + 28, 14, "start", 2, "which ones: docs/rc.md");
        self.text(ECU_LEFT + 16, y + 2 * ROW + 5, 14, "start", 2, "supply: as its maker asks");
        self.text(ECU_LEFT + 16, y + 2 * ROW + 28, 14, "start", 4, "off: no pulses, no preset values");
        self.text(
            BOARD_RIGHT + 40,
            y + 2 * ROW,
            15,
            "start",
            4,
            "SBUS on an ECU port of an STM32F427: an inverter between",
        );
    }

    /// TX, RX and ground from one x to another.
    fn three(&mut self, y: u32, from: u32, to: u32) {
        self.signal((from, y + ROW), (to, y + ROW));
        self.signal((to, y + 2 * ROW), (from, y + 2 * ROW));
        self.wire((from, y + 3 * ROW), (to, y + 3 * ROW));
    }
}

/// The list of a board's ports.
fn ports(board: &Board) -> Vec<String> {
    let ports = board.ports.iter().enumerate().map(|(number, port)| (format!("port {number}"), port));
    let socket = |socket: boards::Socket| {
        format!("port {}, no ECU: RX {}, {}, a receiver", board.ports.len(), socket.rx, socket.name)
    };
    ports
        .chain([("MAVLink, no ECU".to_owned(), &board.telemetry)])
        .map(|(name, port)| format!("{name}: TX {}, RX {}, {}", port.tx, port.rx, port.label))
        .chain(board.socket.map(socket))
        .collect()
}

fn drawing(colours: Colours) -> String {
    let mut svg = Svg { text: String::new(), colours };
    svg.text(40, 40, 22, "start", 4, TITLE);

    let y = 150;
    svg.text(
        40,
        y - 66,
        18,
        "start",
        1,
        "AMT: RS-232 levels, which destroy a 3.3 V port. A transceiver between.",
    );
    svg.board(y);
    svg.wire((BOARD_RIGHT, y), (CONVERTER.0, y));
    svg.three(y, BOARD_RIGHT, CONVERTER.0);
    svg.pull_up(y);
    svg.rect((CONVERTER.0, y - 50), (CONVERTER.1 - CONVERTER.0, 3 * ROW + 90));
    svg.text(CONVERTER.0 + 16, y - 24, 17, "start", 1, "RS-232 transceiver at 3.3 V");
    let pins = [("supply", ""), ("logic in", "RS-232 out"), ("logic out", "RS-232 in"), ("ground", "ground")];
    for (row, (left, right)) in pins.into_iter().enumerate() {
        let y = y + ROW * row as u32 + 5;
        svg.text(CONVERTER.0 + 12, y, 16, "start", 1, left);
        svg.text(CONVERTER.1 - 12, y, 16, "end", 1, right);
    }
    svg.three(y, CONVERTER.1, ECU_LEFT);
    svg.ecu(y, "AMT ECU", "RS-232, up to ±12 V");

    let y = 430;
    let text = "ZK with TTL at 3.3 V: straight. With 5 V TTL, RS-232 or RS-422, as it was ordered: the converter for that between.";
    svg.text(40, y - 66, 18, "start", 1, text);
    svg.board(y);
    svg.wire((BOARD_RIGHT, y), (BOARD_RIGHT + 70, y));
    svg.three(y, BOARD_RIGHT, ECU_LEFT);
    svg.pull_up(y);
    svg.ecu(y, "ZK ECU", "TTL, 3.3 V: ask first");

    let y = 710;
    let text = "A fuel valve on an output (docs/rc.md): closed without power, held for 7 s (plain image: 0.1 s) without the pin.";
    svg.text(40, y - 66, 18, "start", 1, text);
    svg.valve(y);

    let y = 990;
    let text = "A receiver of radio control (docs/rc.md): SBUS and CRSF on a port without an engine, servo pulses on four inputs.";
    svg.text(40, y - 66, 18, "start", 1, text);
    svg.receiver(y);

    // Two columns, as the boards come.
    let top = 1204;
    let mut ends = [top; 2];
    svg.text(40, top - 20, 18, "start", 1, "The board's side: ECU ports by number, as in src/config.rs");
    for board in BOARDS {
        let (column, end) = ends.iter_mut().enumerate().min_by_key(|(_, end)| **end).expect("two columns");
        let x = 40 + 570 * column as u32;
        let mut y = *end + LINE;
        *end += LINE * (ports(board).len() as u32 + 2);
        svg.text(x, y, 15, "start", 1, board.title);
        for port in ports(board) {
            y += LINE;
            svg.text(x + 12, y, 13, "start", 2, &port);
        }
    }
    let height = ends.into_iter().max().unwrap_or(top) + LINE;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\">\n\
         <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"{}\"/>\n{}</svg>\n",
        svg.colours.0[0], svg.text
    )
}

#[test]
fn the_wiring_is_that_of_the_boards() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    for (name, colours) in [("wiring.svg", LIGHT), ("wiring-dark.svg", DARK)] {
        let drawing = drawing(colours);
        let path = docs.join(name);
        if std::env::var_os("JETLINK_WRITE").is_some() {
            std::fs::write(&path, &drawing).expect("it can be written");
        }
        let committed = std::fs::read_to_string(&path).expect("the drawing is there");
        assert!(
            committed == drawing,
            "docs/{name} is not that of the boards: JETLINK_WRITE=1 cargo test -p boards"
        );
    }
}

/// Each port of each board is in it once, and nothing that a pin of an ECU could be.
#[test]
fn the_drawing_has_each_port_and_no_pin_of_an_ecu() {
    let drawing = drawing(LIGHT);
    for board in BOARDS {
        let all: Vec<&str> = drawing.split(board.title).collect();
        assert_eq!(all.len(), 2, "{}", board.title);
        for line in ports(board) {
            assert!(all[1].contains(&format!(">{line}<")), "{}: {line}", board.title);
        }
    }
    assert!(drawing.contains("Not tried on hardware"));
    assert_eq!(drawing.matches(MANUAL).count(), 2);
    let texts = |line: &str| {
        let x: u32 = line.strip_prefix("<text x=\"")?.split('"').next()?.parse().ok()?;
        let y: u32 = line.split("y=\"").nth(1)?.split('"').next()?.parse().ok()?;
        let text = line.split('>').nth(1)?.split('<').next()?;
        (x >= ECU_LEFT && y < 620).then(|| text.to_owned())
    };
    let mut ecus: Vec<String> = drawing.lines().filter_map(texts).collect();
    ecus.sort();
    ecus.dedup();
    let expected =
        ["AMT ECU", "RS-232, up to ±12 V", "RX", "TTL, 3.3 V: ask first", "TX", "ZK ECU", "ground", MANUAL];
    assert_eq!(ecus, expected);
}
