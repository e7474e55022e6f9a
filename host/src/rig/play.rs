//! A played run: actions on an engine, by key or from a script file, and their effects.

pub mod action;
pub mod check;
pub mod judge;
pub mod player;
pub mod script;
