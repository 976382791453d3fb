//! What is to be evaluated.

/// What is to be evaluated.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// The log, as the manifest names it.
    pub file: String,
    /// The condition.
    pub condition: String,
    /// When the robot enters the channel, s on the log's clock.
    pub t_enter_s: f64,
    /// When it leaves, s.
    pub t_exit_s: f64,
    /// Mean velocity, m/s; `None` for the channel's length over the time in it.
    pub velocity_m_s: Option<f64>,
    /// Mass, kg; `None` for the profile's.
    pub mass_kg: Option<f64>,
    /// Length of the channel, m; `None` for the profile's.
    pub channel_length_m: Option<f64>,
    /// What the manifest says of it.
    pub notes: Option<String>,
}

impl Trial {
    /// The trial of a log between two times, of which nothing else is said.
    pub fn of_window(file: String, (t_enter_s, t_exit_s): (f64, f64)) -> Self {
        Self {
            file,
            condition: String::new(),
            t_enter_s,
            t_exit_s,
            velocity_m_s: None,
            mass_kg: None,
            channel_length_m: None,
            notes: None,
        }
    }
}
