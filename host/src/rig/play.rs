//! A run that is played: what a person can do to an engine, by key or from a script file, and what becomes of it.

pub mod action;
pub mod check;
pub mod judge;
pub mod player;
pub mod script;
