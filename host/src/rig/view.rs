//! The screen of a live run.

mod charts;
mod draw;
pub mod keyboard;
pub mod keys;
pub mod model;
mod panels;
mod popup;
mod rows;
mod sgr;
pub mod terminal;
pub mod theme;
mod why;
mod wire;

#[cfg(test)]
mod detail_tests;
#[cfg(test)]
mod judged_tests;
#[cfg(test)]
mod key_tests;
#[cfg(test)]
mod picture;
#[cfg(test)]
mod random_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod truth_tests;
