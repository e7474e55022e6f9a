//! Colours for terminals with sixteen colours: crossterm writes all of them as colours of a palette of 256.

/// Bytes for a terminal, with each of the first sixteen colours of the palette as its basic code.
pub fn sixteen_colours(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len());
    let mut rest = bytes;
    while let Some(place) = rest.windows(2).position(|two| two == b"\x1b[") {
        let (before, sequence) = rest.split_at(place);
        out.extend(before);
        let length = sequence.iter().skip(2).take_while(|byte| matches!(byte, b'0'..=b'9' | b';')).count();
        let (parameters, after) = sequence.split_at(2 + length);
        let parameters = parameters.get(2..).unwrap_or_default();
        out.extend(b"\x1b[");
        match after.first() {
            Some(b'm') => out.extend(codes(&String::from_utf8_lossy(parameters)).into_bytes()),
            _ => out.extend(parameters),
        }
        rest = after;
    }
    out.extend(rest);
    out
}

/// The parameters of one sequence.
fn codes(parameters: &str) -> String {
    let mut all: Vec<String> = Vec::new();
    let mut left: Vec<&str> = parameters.split(';').collect();
    while let Some(first) = left.first().copied() {
        let colour = match left.get(..3) {
            Some(&[ground @ ("38" | "48"), "5", colour]) => {
                colour.parse::<u32>().ok().filter(|&colour| colour < 16).map(|colour| (ground, colour))
            }
            _ => None,
        };
        let taken = match (colour, first) {
            (Some((ground, colour)), _) => {
                let base = if colour < 8 { 30 + colour } else { 90 + colour - 8 };
                all.push((if ground == "38" { base } else { base + 10 }).to_string());
                3
            }
            // Colours of a larger palette and RGB colours have numbers that are not codes.
            (None, "38" | "48") => {
                let taken = if left.get(1) == Some(&"5") { 3 } else { 5 };
                all.extend(left.iter().take(taken).map(|&code| code.to_owned()));
                taken
            }
            (None, code) => {
                all.push(code.to_owned());
                1
            }
        };
        left.drain(..taken.min(left.len()));
    }
    all.join(";")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_colours_have_codes_of_their_own() {
        for (from, to) in [
            ("\x1b[38;5;8m", "\x1b[90m"),
            ("\x1b[38;5;2;49m", "\x1b[32;49m"),
            ("\x1b[1;38;5;15;48;5;0;4m", "\x1b[1;97;40;4m"),
            ("\x1b[48;5;9ma\x1b[0mb", "\x1b[101ma\x1b[0mb"),
            ("\x1b[38;5;208m", "\x1b[38;5;208m"),
            ("\x1b[38;2;1;5;7m", "\x1b[38;2;1;5;7m"),
            ("\x1b[m\x1b[39m", "\x1b[m\x1b[39m"),
            // Not a colour.
            ("\x1b[38;5;2H", "\x1b[38;5;2H"),
            ("\x1b[?25l×4 é\x1b[", "\x1b[?25l×4 é\x1b["),
            ("", ""),
        ] {
            assert_eq!(String::from_utf8(sixteen_colours(from.as_bytes())).unwrap(), to, "{from:?}");
        }
    }
}
