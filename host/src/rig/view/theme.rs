//! Colours and characters, by the terminal's capabilities.

use super::super::fit::{ascii, elided};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols;

/// Capabilities of the terminal.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Theme {
    /// The sixteen colours; without them, bold and reversed text.
    pub colours: bool,
    /// ASCII only.
    pub ascii: bool,
}

/// Mark after an old value, without colours.
pub const OLD: char = '?';

/// Meaning of a text, which determines its colour.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Tone {
    /// As it should be: runs, up.
    Good,
    /// On its way: starts, cools, waits.
    Busy,
    /// Needs a look: lost, held, limited.
    Warn,
    /// Wrong: stopped, faults, missed.
    Bad,
    /// At rest.
    Quiet,
    /// A heading.
    Head,
    /// Plain text.
    Plain,
    /// Selected text.
    Selected,
}

impl Theme {
    /// From the environment: `NO_COLOR`, `TERM` and the locale.
    pub fn of(ascii: bool, variable: impl Fn(&str) -> Option<String>) -> Self {
        let set = |name: &str| variable(name).filter(|value| !value.is_empty());
        let term = set("TERM").unwrap_or_default();
        // The first of the three that is set counts.
        let locale = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter().find_map(set).unwrap_or_default();
        let utf8 = locale.to_lowercase().replace('-', "").contains("utf8") || cfg!(windows);
        // The VT525 is the first one with colours.
        let of_dec = ["vt1", "vt2", "vt3", "vt4"].iter().any(|vt| term.starts_with(vt));
        let monochrome = term.ends_with("-m") || term.ends_with("-mono") || of_dec;
        Self {
            colours: set("NO_COLOR").is_none() && !monochrome,
            // The Linux console has neither braille nor all blocks.
            ascii: ascii || !utf8 || term == "linux",
        }
    }

    /// The style of a text.
    pub fn style(self, tone: Tone) -> Style {
        let plain = Style::new();
        if !self.colours {
            return match tone {
                Tone::Bad | Tone::Warn | Tone::Head => plain.add_modifier(Modifier::BOLD),
                Tone::Selected => plain.add_modifier(Modifier::REVERSED),
                Tone::Quiet => plain.add_modifier(Modifier::DIM),
                Tone::Good | Tone::Busy | Tone::Plain => plain,
            };
        }
        match tone {
            Tone::Good => plain.fg(Color::Green),
            Tone::Busy => plain.fg(Color::Cyan),
            Tone::Warn => plain.fg(Color::Yellow).add_modifier(Modifier::BOLD),
            Tone::Bad => plain.fg(Color::Red).add_modifier(Modifier::BOLD),
            Tone::Quiet => plain.fg(Color::DarkGray),
            Tone::Head => plain.add_modifier(Modifier::BOLD),
            Tone::Plain => plain,
            Tone::Selected => plain.add_modifier(Modifier::REVERSED),
        }
    }

    /// Mark after a text without colours: it needs attention, or its value is old.
    pub const fn sign(self, tone: Tone) -> Option<char> {
        match tone {
            _ if self.colours => None,
            Tone::Bad | Tone::Warn => Some('!'),
            Tone::Quiet => Some(OLD),
            Tone::Good | Tone::Busy | Tone::Plain | Tone::Head | Tone::Selected => None,
        }
    }

    /// The border of a panel.
    pub const fn border(self) -> symbols::border::Set<'static> {
        if self.ascii {
            symbols::border::Set {
                top_left: "+",
                top_right: "+",
                bottom_left: "+",
                bottom_right: "+",
                vertical_left: "|",
                vertical_right: "|",
                horizontal_top: "-",
                horizontal_bottom: "-",
            }
        } else {
            symbols::border::PLAIN
        }
    }

    /// The characters of a text that the terminal can show.
    pub fn text(self, text: &str) -> String {
        if !self.ascii {
            return text.to_owned();
        }
        ascii(text)
    }

    /// Mark for text that is left out.
    pub const fn mark(self) -> char {
        if self.ascii { '~' } else { '…' }
    }

    /// A text of at most this width, in characters that the terminal can show.
    pub fn cut(self, text: &str, width: usize) -> String {
        elided(&self.text(text), width, self.mark())
    }

    /// A gauge of this width, filled to this share, with a mark at its limit.
    pub fn gauge(self, width: usize, share: f64, limit: Option<f64>) -> String {
        let (full, empty, mark) = if self.ascii { ('#', '.', '|') } else { ('█', '░', '│') };
        let cell = |share: f64| (share.clamp(0.0, 1.0) * width as f64).round() as usize;
        let filled = cell(share);
        let limit = limit.map(|limit| cell(limit).min(width.saturating_sub(1)));
        (0..width)
            .map(|i| match limit {
                Some(limit) if i == limit => mark,
                _ if i < filled => full,
                _ => empty,
            })
            .collect()
    }

    /// The marks of a chart.
    pub const fn marker(self) -> symbols::Marker {
        if self.ascii { symbols::Marker::Dot } else { symbols::Marker::Braille }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn theme(variables: &[(&str, &str)]) -> Theme {
        Theme::of(false, |name| {
            variables.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn the_environment_selects_colours_and_characters() {
        let utf8 = ("LANG", "de_DE.UTF-8");
        let both = |colours, ascii| Theme { colours, ascii };
        assert_eq!(theme(&[utf8, ("TERM", "xterm-256color")]), both(true, false));
        assert_eq!(theme(&[utf8, ("TERM", "xterm"), ("NO_COLOR", "1")]), both(false, false));
        assert_eq!(theme(&[utf8, ("TERM", "xterm"), ("NO_COLOR", "")]), both(true, false));
        assert_eq!(theme(&[utf8, ("TERM", "linux")]), both(true, true));
        for (term, colours) in
            [("vt100", false), ("vt220", false), ("vt340", false), ("vt420", false), ("vt525", true)]
        {
            assert_eq!(theme(&[utf8, ("TERM", term)]), both(colours, false), "{term}");
        }
        assert_eq!(theme(&[utf8, ("TERM", "xterm"), ("LC_ALL", "C")]), both(true, true));
        assert_eq!(theme(&[("TERM", "xterm")]), both(true, true));
    }

    #[test]
    fn ascii_has_no_other_characters() {
        let ascii = Theme { colours: true, ascii: true };
        assert_eq!(ascii.text("×4 … 512 °C ü"), "x4 ~ 512 C ?");
        assert_eq!(ascii.gauge(10, 0.5, Some(0.9)), "#####....|");
        assert_eq!(Theme { ascii: false, ..ascii }.gauge(4, 2.0, None), "████");
    }
}
