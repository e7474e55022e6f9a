//! The colours of a plot, for a light page and for a dark one.

use super::super::context::Stage;

/// All of them.
#[derive(Clone, Copy, Debug)]
pub struct Palette {
    /// Behind everything.
    pub ground: &'static str,
    /// Text and axes.
    pub ink: &'static str,
    /// Grid lines.
    pub grid: &'static str,
    /// Shaft speed.
    pub rpm: &'static str,
    /// Exhaust gas temperature.
    pub egt: &'static str,
    /// The commanded demand.
    pub commanded: &'static str,
    /// The sent demand.
    pub sent: &'static str,
    /// Events.
    pub mark: &'static str,
    /// Times in which nothing is received.
    pub gap: &'static str,
    /// Emergency stop, standby, run on the wire.
    pub wire: [&'static str; 3],
    dark: bool,
}

impl Palette {
    /// For a light page, or a dark one.
    pub const fn of(dark: bool) -> Self {
        if dark { Self::DARK } else { Self::LIGHT }
    }

    const LIGHT: Self = Self {
        ground: "#ffffff",
        ink: "#303030",
        grid: "#dddddd",
        rpm: "#1f5fb4",
        egt: "#c83c1e",
        commanded: "#707070",
        sent: "#1d7d30",
        mark: "#7a1f7a",
        gap: "#c9c9c9",
        wire: ["#f08070", "#d4d4d4", "#a8dca8"],
        dark: false,
    };

    const DARK: Self = Self {
        ground: "#0d1117",
        ink: "#d0d7de",
        grid: "#30363d",
        rpm: "#6ea8fe",
        egt: "#ff8f6b",
        commanded: "#a0a0a0",
        sent: "#5fd07a",
        mark: "#d9a0ff",
        gap: "#3d444d",
        wire: ["#a03a30", "#3d444d", "#1f5a2c"],
        dark: true,
    };

    /// The ground of a stage.
    pub const fn stage(self, stage: Stage) -> &'static str {
        if self.dark {
            match stage {
                Stage::Standby | Stage::Done | Stage::Commanded => "#161b22",
                Stage::Start => "#2b2412",
                Stage::Idle => "#13261a",
                Stage::Steps => "#12233a",
                Stage::Cooling => "#2a1624",
                Stage::Failed => "#4a1515",
                Stage::SourceLost | Stage::Scenario(_) => "#2b2a12",
                Stage::Played => "#231a36",
            }
        } else {
            match stage {
                Stage::Standby | Stage::Commanded => "#eeeeee",
                Stage::Start => "#fff0d0",
                Stage::Idle => "#e6f4e2",
                Stage::Steps => "#e2eefa",
                Stage::Cooling => "#f8e6ee",
                Stage::Done => "#f4f4f4",
                Stage::Failed => "#ffc8c8",
                Stage::SourceLost | Stage::Scenario(_) => "#fdf6cc",
                Stage::Played => "#eee6fa",
            }
        }
    }
}
