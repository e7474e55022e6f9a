//! The keys, in one table: for the program, its help, the documentation and the tests.

use super::super::play::action::{Act, Fault, Wish};
use crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

/// What a key does.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Does {
    /// Acts on the selected engine.
    Wish(Wish),
    /// Acts on all engines.
    WishAll(Wish),
    /// Selects the engine with this number, counted from 1.
    Select,
    /// Selects the previous engine.
    Previous,
    /// Selects the next engine.
    Next,
    /// Opens or closes the menu of faults.
    Faults,
    /// Opens the confirmation of the release of the emergency stop.
    Release,
    /// Shows or hides the start conditions and limits of the engine.
    Why,
    /// Shows or hides the last frames on the wire.
    Wire,
    /// Shows the next page of the keys; after the last one hides them.
    Help,
    /// Pauses or continues the run.
    Pause,
    /// Pauses the run, and lets 0.1 s pass.
    Step,
    /// Sets the next higher speed.
    Faster,
    /// Sets the next lower speed.
    Slower,
    /// Lets the run choose its speed.
    Auto,
    /// Turns the mouse on or off.
    Mouse,
    /// Closes what is open.
    Close,
    /// Ends the run.
    Quit,
    /// Ends the run as Ctrl-C does.
    Interrupt,
    /// Suspends the program until the shell continues it.
    Suspend,
}

impl Does {
    /// Whether it acts on engines, and a scenario does it by script. A scenario leaves the emergency stop and its release to a person.
    pub const fn is_of_script(self) -> bool {
        match self {
            Self::Wish(Wish::Act(Act::Release)) | Self::WishAll(_) | Self::Release => false,
            Self::Wish(_) | Self::Faults => true,
            _ => false,
        }
    }
}

/// A row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// The keys.
    pub codes: &'static [KeyCode],
    /// With Ctrl.
    pub ctrl: bool,
    /// Their name, for people.
    pub name: &'static str,
    /// Effect.
    pub does: Does,
    /// Effect in words.
    pub text: &'static str,
    /// Word for the last line of the screen; empty where it is not shown there.
    pub short: &'static str,
}

impl Key {
    /// Whether it does nothing where the keys move a transmitter.
    pub fn is_without_transmitter(&self) -> bool {
        by_transmitter(self) == NOTHING
    }
}

/// Effect of a key that acts on scripts, where the keys move a transmitter.
const NOTHING: &str = "nothing: there is no script";

const fn key(
    codes: &'static [KeyCode],
    name: &'static str,
    does: Does,
    text: &'static str,
    short: &'static str,
) -> Key {
    Key { codes, ctrl: false, name, does, text, short }
}

const fn act(act: Act) -> Does {
    Does::Wish(Wish::Act(act))
}

const fn with_ctrl(codes: &'static [KeyCode], name: &'static str, does: Does, text: &'static str) -> Key {
    Key { codes, ctrl: true, name, does, text, short: "" }
}

use KeyCode::Char;

const STOP: Wish = Wish::Act(Act::EmergencyStop);
const DIGITS: [KeyCode; 8] =
    [Char('1'), Char('2'), Char('3'), Char('4'), Char('5'), Char('6'), Char('7'), Char('8')];

/// Keys that always act. Those of an open menu take precedence.
pub const KEYS: [Key; 29] = [
    key(&[Char(' ')], "Space", Does::WishAll(STOP), "emergency stop of all engines", "STOP ALL"),
    key(&[Char('r')], "r", Does::Release, "release the stop (then y)", ""),
    key(&[Char('?'), KeyCode::F(1)], "?", Does::Help, "these keys", "keys"),
    key(&[Char('q')], "q", Does::Quit, "end: verdict and events", "end"),
    key(&[KeyCode::Esc], "Esc", Does::Close, "close what is open", ""),
    key(&[Char('f')], "f", Does::Faults, "break something: faults", "faults"),
    key(&[Char('b')], "b", act(Act::Script), "restart its script", "script"),
    key(&[Char('a')], "a", act(Act::Arm), "arm: allow a start", ""),
    key(&[Char('d')], "d", act(Act::Disarm), "disarm: allow no start", ""),
    key(&[Char('s')], "s", act(Act::Start), "start: run at idle", "start"),
    key(&[Char('t')], "t", act(Act::Standby), "standby: shut down and cool", "standby"),
    key(&[Char('h')], "h", Does::Wish(Wish::HandOver), "hand over: with --rc only", ""),
    key(&[KeyCode::Up], "Up", Does::Wish(Wish::Step(50)), "demand 5 % up", "demand"),
    key(&[KeyCode::Down], "Down", Does::Wish(Wish::Step(-50)), "demand 5 % down", ""),
    key(&[KeyCode::PageUp], "PgUp", Does::Wish(Wish::Step(200)), "demand 20 % up", ""),
    key(&[KeyCode::PageDown], "PgDn", Does::Wish(Wish::Step(-200)), "demand 20 % down", ""),
    key(&DIGITS, "1 to 8", Does::Select, "select an engine", ""),
    key(&[KeyCode::Left], "Left", Does::Previous, "select the engine before", ""),
    key(&[KeyCode::Right, KeyCode::Tab], "Right", Does::Next, "select the next one (or Tab)", ""),
    key(&[Char('w')], "w", Does::Why, "why: start conditions, limits", "why"),
    key(&[Char('v')], "v", Does::Wire, "wire: the last frames", "wire"),
    key(&[Char('p')], "p", Does::Pause, "pause, or continue", "pause"),
    key(&[Char('.')], ".", Does::Step, "pause, and let 0.1 s pass", ""),
    key(&[Char('+'), Char('=')], "+", Does::Faster, "faster, up to ×60", "speed"),
    key(&[Char('-')], "-", Does::Slower, "slower, down to ×1", ""),
    key(&[Char('0')], "0", Does::Auto, "speed chosen by the run", ""),
    key(&[Char('m')], "m", Does::Mouse, "mouse on or off", ""),
    with_ctrl(&[Char('c')], "Ctrl-C", Does::Interrupt, "end with status 130"),
    with_ctrl(&[Char('z')], "Ctrl-Z", Does::Suspend, "suspend; fg continues"),
];

/// Keys of the menu of faults.
pub const FAULTS: [Key; 8] = [
    key(&[Char('c')], "c", Does::Wish(Wish::Toggle(Fault::Cut)), "cut both wires, or mend them", ""),
    key(
        &[Char('e')],
        "e",
        Does::Wish(Wish::Toggle(Fault::CutToEcu)),
        "cut the wire to the ECU, or mend it",
        "",
    ),
    key(
        &[Char('i')],
        "i",
        Does::Wish(Wish::Toggle(Fault::CutToNode)),
        "cut the wire to the node, or mend it",
        "",
    ),
    key(&[Char('n')], "n", Does::Wish(Wish::Toggle(Fault::Noise)), "noise on the line, or end it", ""),
    key(&[Char('o')], "o", Does::Wish(Wish::Toggle(Fault::FlameOut)), "flame-out", ""),
    key(&[Char('p')], "p", Does::Wish(Wish::Toggle(Fault::Power)), "the ECU's power off, or on", ""),
    key(&[Char('x')], "x", Does::Wish(Wish::Toggle(Fault::Reset)), "the watchdog resets the node", ""),
    key(&[Char('s')], "s", Does::Wish(Wish::Toggle(Fault::Silence)), "silence its source, or end that", ""),
];

/// Key that confirms the release of the emergency stop.
pub const RELEASE: [Key; 1] = [key(&[Char('y')], "y", act(Act::Release), "release it", "")];

/// Keys that start an engine after an emergency stop, without and with a transmitter. Each step is a group of keys.
const RESTART: &[&[Does]] =
    &[&[Does::Release, act(Act::Release)], &[act(Act::Disarm), act(Act::Arm), act(Act::Start)]];
const RESTART_BY_SWITCH: &[&[Does]] = &[&[act(Act::Standby)], &[act(Act::Start)]];

/// Keys that start an engine after an emergency stop, step by step.
pub fn restart(transmitter: bool) -> Vec<Vec<&'static Key>> {
    let key = |does: &Does| KEYS.iter().chain(&RELEASE).find(|key| key.does == *does);
    let steps = if transmitter { RESTART_BY_SWITCH } else { RESTART };
    steps.iter().map(|step| step.iter().filter_map(key).collect()).collect()
}

/// The same in words.
pub fn restart_text(transmitter: bool) -> String {
    let names = |step: &Vec<&Key>| step.iter().map(|key| key.name).collect::<Vec<_>>().join(" ");
    let steps: Vec<String> = restart(transmitter).iter().map(names).collect();
    format!("start after an emergency stop: {}", steps.join(", then "))
}

/// Effect of a key in words, where the keys move a transmitter.
pub fn by_transmitter(key: &Key) -> &'static str {
    match key.does {
        Does::WishAll(Wish::Act(Act::EmergencyStop)) | Does::Wish(Wish::Act(Act::Disarm)) => {
            "the switch to stop"
        }
        Does::Release => "the switch to standby (then y)",
        Does::Wish(Wish::Act(Act::Arm | Act::Standby | Act::Release)) => "the switch to standby",
        Does::Wish(Wish::Act(Act::Start)) => "the switch to run allowed",
        Does::Wish(Wish::Step(50)) => "the stick 5 % up",
        Does::Wish(Wish::Step(-50)) => "the stick 5 % down",
        Does::Wish(Wish::Step(200)) => "the stick 20 % up",
        Does::Wish(Wish::Step(-200)) => "the stick 20 % down",
        Does::Wish(Wish::HandOver) => "hand over, or take back",
        Does::Wish(Wish::Toggle(Fault::Silence)) => "the transmitter off, or on",
        Does::Wish(Wish::Act(Act::Script)) => NOTHING,
        _ => key.text,
    }
}

/// Effect of a pressed key. `open`: table of the open menu.
pub fn does(event: &KeyEvent, open: &[Key]) -> Option<Does> {
    // Windows also sends releases.
    if event.kind != KeyEventKind::Press {
        return None;
    }
    let ctrl = event.modifiers.contains(KeyModifiers::CONTROL);
    // Space is the emergency stop, whichever modifiers are held.
    let any = event.code == Char(' ');
    // Letters also act with Caps Lock: the tables have no capital letters.
    let code = match event.code {
        Char(letter) => Char(letter.to_ascii_lowercase()),
        other => other,
    };
    let is_it = |key: &&Key| (any || key.ctrl == ctrl) && key.codes.contains(&code);
    let mut all = open.iter().chain(&KEYS);
    all.find(is_it).map(|key| key.does)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn press(code: KeyCode, modifiers: KeyModifiers) -> KeyEvent {
        KeyEvent::new(code, modifiers)
    }

    #[test]
    fn no_key_means_two_things() {
        for table in [&KEYS[..], &FAULTS] {
            for (i, key) in table.iter().enumerate() {
                for code in key.codes {
                    let others = table.iter().skip(i + 1).filter(|other| other.ctrl == key.ctrl);
                    assert!(others.into_iter().all(|other| !other.codes.contains(code)), "{}", key.name);
                }
            }
        }
    }

    #[test]
    fn space_stops_everywhere() {
        for open in [&[][..], &FAULTS, &RELEASE] {
            for held in [KeyModifiers::NONE, KeyModifiers::CONTROL, KeyModifiers::SHIFT, KeyModifiers::all()]
            {
                let space = press(KeyCode::Char(' '), held);
                assert_eq!(
                    does(&space, open),
                    Some(Does::WishAll(Wish::Act(Act::EmergencyStop))),
                    "{held:?}"
                );
            }
            assert!(open.iter().all(|key| !key.codes.contains(&KeyCode::Char(' '))));
        }
    }

    #[test]
    fn letters_act_with_caps_lock() {
        for (open, key) in [&KEYS[..], &FAULTS, &RELEASE]
            .into_iter()
            .flat_map(|open| open.iter().map(move |key| (open, key)))
        {
            for &code in key.codes {
                let Char(letter) = code else { continue };
                let held = if key.ctrl { KeyModifiers::CONTROL } else { KeyModifiers::NONE };
                let (small, capital) = (press(code, held), press(Char(letter.to_ascii_uppercase()), held));
                assert!(does(&small, open).is_some(), "{letter}");
                assert_eq!(does(&capital, open), does(&small, open), "{letter}");
            }
        }
    }

    #[test]
    fn only_presses_count_and_ctrl_is_another_key() {
        let mut release = press(KeyCode::Char('q'), KeyModifiers::NONE);
        assert_eq!(does(&release, &[]), Some(Does::Quit));
        release.kind = KeyEventKind::Release;
        assert_eq!(does(&release, &[]), None);
        assert_eq!(does(&press(KeyCode::Char('q'), KeyModifiers::CONTROL), &[]), None);
        assert_eq!(does(&press(KeyCode::Char('c'), KeyModifiers::CONTROL), &[]), Some(Does::Interrupt));
        assert_eq!(does(&press(KeyCode::Char('z'), KeyModifiers::CONTROL), &[]), Some(Does::Suspend));
        assert_eq!(does(&press(KeyCode::Char('y'), KeyModifiers::NONE), &[]), None);
    }

    #[test]
    fn the_documentation_has_what_the_keys_of_a_transmitter_do() {
        let page = include_str!("../../../../docs/rig.md");
        let rows: Vec<&str> = page.lines().filter(|line| line.starts_with("| `")).collect();
        let mut count = 0;
        for key in KEYS.iter().chain(&FAULTS).chain(&RELEASE) {
            let text = by_transmitter(key);
            let what =
                text.split(" (").next().unwrap().split(|c: char| c.is_ascii_digit()).next().unwrap().trim();
            if text != key.text && !what.starts_with("nothing") {
                let name = format!("`{}`", key.name);
                assert!(rows.iter().any(|row| row.contains(&name) && row.contains(what)), "{name}: {what}");
                count += 1;
            }
        }
        assert_eq!(count, 13);
    }

    #[test]
    fn the_documentation_has_the_table() {
        let page = include_str!("../../../../docs/rig.md");
        for key in KEYS.iter().chain(&FAULTS).chain(&RELEASE) {
            let row = format!("| `{}` | {} |", key.name, key.text);
            assert!(page.contains(&row), "docs/rig.md lacks {row}");
        }
        for transmitter in [false, true] {
            let names =
                |step: Vec<&Key>| step.iter().map(|key| format!("`{}`", key.name)).collect::<Vec<_>>();
            let steps: Vec<String> =
                restart(transmitter).into_iter().map(|step| names(step).join(" ")).collect();
            let text = format!("After an emergency stop, start an engine with {}", steps.join(", then "));
            assert!(page.contains(&text), "docs/rig.md lacks {text}");
        }
    }
}
