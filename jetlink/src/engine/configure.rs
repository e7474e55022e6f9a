//! Settings given to a running engine: those of the supervision at once, those of the link when the engine is at rest.

use super::config::{Supervision, SupervisionError};
use super::data::Engine;
use crate::config::{LinkSettings, LinkSettingsError};
use embassy_time::Instant;

impl Engine {
    /// Changes the settings of the supervision, from the next frame, command or deadline on.
    ///
    /// # Errors
    /// The first setting that is out of its range, with nothing changed.
    pub fn configure(&mut self, now: Instant, config: &Supervision) -> Result<(), SupervisionError> {
        config.validate()?;
        self.touch();
        self.config = *config;
        self.sources.configure(config);
        self.exhaust.configure(config.burning_egt);
        self.update(now);
        Ok(())
    }

    /// Changes the settings of the link as soon as the engine is at rest: standby or an emergency stop is in force, and the ECU
    /// reports a stopped engine. Later settings replace earlier ones that still wait.
    ///
    /// # Errors
    /// [`LinkSettingsError`], with nothing changed.
    pub fn configure_link(&mut self, now: Instant, settings: &LinkSettings) -> Result<(), LinkSettingsError> {
        settings.check(self.line, &self.ecu)?;
        self.link_settings = Some(*settings);
        self.update(now);
        Ok(())
    }

    /// Whether settings of the link wait until the engine is at rest.
    pub const fn link_settings_wait(&self) -> bool {
        self.link_settings.is_some()
    }
}
