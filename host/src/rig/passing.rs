//! How engine time passes.

/// The speeds that keys step through.
pub const SPEEDS: [u32; 6] = [1, 2, 4, 10, 20, 60];

/// How a run passes, to be shown.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Passing {
    /// This multiple of real time.
    pub speed: u32,
    /// The run chooses its speed itself.
    pub auto: bool,
    /// The run is paused.
    pub paused: bool,
}
