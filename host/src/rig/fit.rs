//! Fits texts into the available width.

/// The text in at most this width. The end is left out and marked, in whole words if half of the width remains.
pub fn elided(text: &str, width: usize, mark: char) -> String {
    if text.chars().count() <= width {
        return text.to_owned();
    }
    let room = width.saturating_sub(1);
    let start: String = text.chars().take(room).collect();
    let between = |c: char| matches!(c, ' ' | '-');
    let whole = if text.chars().nth(room).is_some_and(between) { Some(start.as_str()) } else { None };
    let whole = whole.or_else(|| start.rfind(between).and_then(|end| start.get(..end)));
    let whole = whole.filter(|whole| whole.chars().count() * 2 >= room).unwrap_or(&start);
    let whole = whole.trim_end_matches([' ', ',', ';', ':', '-']);
    whole.chars().chain((width > 0).then_some(mark)).collect()
}

/// The first of these texts that fits; if none does, the last one, elided.
pub fn first_that_fits(texts: &[String], width: usize, mark: char) -> String {
    let fits = texts.iter().find(|text| text.chars().count() <= width);
    fits.cloned().unwrap_or_else(|| texts.last().map_or_else(String::new, |text| elided(text, width, mark)))
}

/// As many names as fit, and how many more there are.
pub fn listed(head: &str, names: &[String], width: usize, mark: char) -> String {
    let texts: Vec<String> = (1..=names.len())
        .rev()
        .map(|count| {
            let (first, more) = names.split_at(count);
            let more = if more.is_empty() { String::new() } else { format!(" +{}", more.len()) };
            format!("{head}{}{more}", first.join(", "))
        })
        .collect();
    first_that_fits(&texts, width, mark)
}

/// Units that follow a number, after a space.
const UNITS: [&str; 19] = [
    "%", "°C", "°C/s", "C", "rpm", "rpm/s", "s", "ms", "µs", "us", "mV", "V", "mA", "A", "Pa", "g", "Hz",
    "L", "L/min",
];

/// The words of a text, each with the spaces after it. A number is one word with its unit, and with its groups of digits.
fn words(text: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for word in text.split_inclusive(' ') {
        let bare = word.trim_matches(|c: char| c == ' ' || (c.is_ascii_punctuation() && c != '%'));
        let is_group = bare.len() == 3 && bare.bytes().all(|byte| byte.is_ascii_digit());
        let of_number = words.last().is_some_and(|last| {
            // One space, and a digit before it.
            last.strip_suffix(' ').is_some_and(|last| last.ends_with(|c: char| c.is_ascii_digit()))
        });
        match words.last_mut() {
            Some(last) if of_number && (is_group || UNITS.contains(&bare)) => last.push_str(word),
            _ => words.push(word.to_owned()),
        }
    }
    words
}

/// The text in lines of at most this width, broken between words. All but the first begin with `indent` spaces.
pub fn wrapped(text: &str, width: usize, indent: usize, mark: char) -> Vec<String> {
    let mut lines = vec![String::new()];
    // The spaces at the beginning and between columns are kept.
    for word in words(text) {
        let Some(line) = lines.last_mut() else { break };
        if line.chars().count() + word.trim_end().chars().count() > width && !line.trim().is_empty() {
            lines.push(format!("{:indent$}{word}", ""));
        } else {
            line.push_str(&word);
        }
    }
    lines.into_iter().map(|line| elided(line.trim_end(), width, mark)).collect()
}

/// The text for an ASCII-only terminal.
pub fn ascii(text: &str) -> String {
    let ascii = |c: char| match c {
        '°' => None,
        '×' => Some('x'),
        '→' => Some('>'),
        '←' => Some('<'),
        '↑' => Some('^'),
        '↓' => Some('v'),
        '…' => Some('~'),
        'µ' => Some('u'),
        '–' | '—' | '−' => Some('-'),
        '•' => Some('*'),
        '│' => Some('|'),
        '─' => Some('-'),
        '└' | '┌' | '┐' | '┘' => Some('+'),
        '✓' => Some('+'),
        '✗' => Some('!'),
        c if c.is_ascii() => Some(c),
        _ => Some('?'),
    };
    text.chars().filter_map(ascii).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_ends_with_a_whole_word_and_a_mark() {
        for (text, width, expected) in [
            ("fits", 4, "fits"),
            ("left: AMT Olympus, 2400 baud", 26, "left: AMT Olympus, 2400…"),
            ("left: AMT Olympus, 2400 baud", 19, "left: AMT Olympus…"),
            ("start: ignition-min-throttle", 18, "start: ignition…"),
            ("one-long-word", 0, ""),
            ("booster", 4, "boo…"),
        ] {
            let elided = elided(text, width, '…');
            assert_eq!(elided, expected);
            assert!(elided.chars().count() <= width);
        }
    }

    #[test]
    fn a_list_ends_with_the_number_of_names_left_out() {
        let names = ["egt-high", "rpm-low", "pump"].map(str::to_owned);
        assert_eq!(listed("FAULT: ", &names, 40, '…'), "FAULT: egt-high, rpm-low, pump");
        assert_eq!(listed("FAULT: ", &names, 28, '…'), "FAULT: egt-high, rpm-low +1");
        assert_eq!(listed("FAULT: ", &names, 20, '…'), "FAULT: egt-high +2");
        assert_eq!(listed("FAULT: ", &[], 20, '…'), "");
    }

    #[test]
    fn a_long_text_continues_in_the_next_line() {
        let text = "  12.0  left  command from bench rejected";
        assert_eq!(wrapped(text, 80, 14, '…'), [text]);
        let lines = wrapped(text, 30, 14, '…');
        assert_eq!(lines, ["  12.0  left  command from", "              bench rejected"]);
    }

    #[test]
    fn a_number_stays_with_its_unit_and_in_one_piece() {
        for (text, width, expected) in [
            ("limit of the exhaust 100 °C now", 25, ["limit of the exhaust", "100 °C now"]),
            ("the demand rises at 50.0 % a second", 25, ["the demand rises at", "50.0 % a second"]),
            ("reported by its ECU: 12 345 rpm", 23, ["reported by its ECU:", "12 345 rpm"]),
            ("within 30 engines", 10, ["within 30", "engines"]),
        ] {
            assert_eq!(wrapped(text, width, 0, '…'), expected);
        }
        // Longer than a line.
        assert_eq!(wrapped("12 345 678 rpm", 8, 0, '…'), ["12 345…"]);
    }
}
