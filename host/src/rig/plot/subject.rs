//! What is drawn: an engine, and what happened to it.

/// Something that happened.
#[derive(Clone, PartialEq, Debug)]
pub struct Happening {
    /// When, in seconds.
    pub t: f64,
    /// To which engine; `None`: to all.
    pub engine: Option<usize>,
    /// What.
    pub text: String,
}

/// What is drawn of one engine.
#[derive(Debug)]
pub struct Subject {
    /// What it is.
    pub caption: String,
    /// Shaft speed at full throttle.
    pub max_rpm: f64,
    /// Above this EGT in °C the node reports a limit.
    pub egt_limit: Option<f64>,
    /// It is commanded by rpm.
    pub by_rpm: bool,
}
