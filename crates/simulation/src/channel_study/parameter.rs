//! The parameters of a channel by name, so that studies can change any of them.

use beam_channel::Setup;

/// A parameter of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// Semi-axis of the body along its way.
    SemiLength,
    /// Semi-axis of the body across its way.
    SemiWidth,
    /// Between the tips of opposite beams.
    Width,
    /// From a beam's base to its tip.
    BeamLength,
    /// A beam's upright side.
    BeamWidth,
    /// A beam's bending side.
    Thickness,
    /// Flexural modulus.
    Modulus,
    /// Kinetic friction.
    Friction,
    /// From one beam to the next.
    Spacing,
    /// Of the body from the middle of the channel, to the left.
    OffCentre,
    /// Of the body's nose, to the left.
    Yaw,
}

/// What a parameter is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// m.
    Length,
    /// Pa.
    Pressure,
    /// rad.
    Angle,
    /// Nothing.
    Number,
}

impl Parameter {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::SemiLength,
        Self::SemiWidth,
        Self::Width,
        Self::BeamLength,
        Self::BeamWidth,
        Self::Thickness,
        Self::Modulus,
        Self::Friction,
        Self::Spacing,
        Self::OffCentre,
        Self::Yaw,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::SemiLength => "rx",
            Self::SemiWidth => "ry",
            Self::Width => "width",
            Self::BeamLength => "beam-length",
            Self::BeamWidth => "beam-width",
            Self::Thickness => "thickness",
            Self::Modulus => "modulus",
            Self::Friction => "friction",
            Self::Spacing => "spacing",
            Self::OffCentre => "off-centre",
            Self::Yaw => "yaw",
        }
    }

    /// The name of a column of its values, with the unit.
    pub fn column(self) -> String {
        let unit = match self.dimension() {
            Dimension::Length => "_m",
            Dimension::Pressure => "_pa",
            Dimension::Angle => "_rad",
            Dimension::Number => "",
        };
        self.name().replace('-', "_") + unit
    }

    /// What it is measured in.
    pub fn dimension(self) -> Dimension {
        match self {
            Self::Modulus => Dimension::Pressure,
            Self::Friction => Dimension::Number,
            Self::Yaw => Dimension::Angle,
            _ => Dimension::Length,
        }
    }

    /// Its value in a set-up, SI.
    pub fn get(self, setup: &Setup) -> f64 {
        *self.position(&mut setup.clone())
    }

    /// Changes it in a set-up. All others stay as they are: a wider body is then deeper in.
    pub fn set(self, setup: &mut Setup, value: f64) {
        *self.position(setup) = value;
    }

    fn position(self, setup: &mut Setup) -> &mut f64 {
        match self {
            Self::SemiLength => &mut setup.ellipse.semi_length_m,
            Self::SemiWidth => &mut setup.ellipse.semi_width_m,
            Self::Width => &mut setup.channel.width_m,
            Self::BeamLength => &mut setup.beam.length_m,
            Self::BeamWidth => &mut setup.beam.width_m,
            Self::Thickness => &mut setup.beam.thickness_m,
            Self::Modulus => &mut setup.beam.flexural_modulus_pa,
            Self::Friction => &mut setup.beam.friction,
            Self::Spacing => &mut setup.channel.pitch_m,
            Self::OffCentre => &mut setup.pose.offset_m,
            Self::Yaw => &mut setup.pose.yaw_rad,
        }
    }
}
