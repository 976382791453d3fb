//! The columns of a robot's telemetry, by the names they go by.

/// A column of telemetry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Telemetry {
    /// Position of the right legs.
    RightLeg,
    /// Position of the left legs.
    LeftLeg,
    /// Duty of the right motor.
    RightDuty,
    /// Duty of the left motor.
    LeftDuty,
    /// Back EMF of the right motor.
    RightBackEmf,
    /// Back EMF of the left motor.
    LeftBackEmf,
    /// Battery voltage.
    Battery,
    /// Current that both motors, or the whole robot, draw.
    Current,
    /// Current of the right motor.
    RightCurrent,
    /// Current of the left motor.
    LeftCurrent,
    /// Electrical power of both motors, or of the whole robot.
    Power,
    /// Electrical power of the right motor.
    RightPower,
    /// Electrical power of the left motor.
    LeftPower,
    /// Angular rate about x.
    GyroX,
    /// Angular rate about y.
    GyroY,
    /// Angular rate about z.
    GyroZ,
    /// Acceleration along x.
    AccelerationX,
    /// Acceleration along y.
    AccelerationY,
    /// Acceleration along z.
    AccelerationZ,
}

impl Telemetry {
    /// All of them.
    pub const ALL: [Self; 19] = [
        Self::RightLeg,
        Self::LeftLeg,
        Self::RightDuty,
        Self::LeftDuty,
        Self::RightBackEmf,
        Self::LeftBackEmf,
        Self::Battery,
        Self::Current,
        Self::RightCurrent,
        Self::LeftCurrent,
        Self::Power,
        Self::RightPower,
        Self::LeftPower,
        Self::GyroX,
        Self::GyroY,
        Self::GyroZ,
        Self::AccelerationX,
        Self::AccelerationY,
        Self::AccelerationZ,
    ];

    /// What the electrical power of motors is computed from.
    pub const MOTORS: [Self; 5] =
        [Self::RightDuty, Self::LeftDuty, Self::RightBackEmf, Self::LeftBackEmf, Self::Battery];

    /// What people call it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::RightLeg => "right leg position",
            Self::LeftLeg => "left leg position",
            Self::RightDuty => "right motor duty",
            Self::LeftDuty => "left motor duty",
            Self::RightBackEmf => "right back EMF",
            Self::LeftBackEmf => "left back EMF",
            Self::Battery => "battery",
            Self::Current => "current",
            Self::RightCurrent => "right motor current",
            Self::LeftCurrent => "left motor current",
            Self::Power => "power",
            Self::RightPower => "right motor power",
            Self::LeftPower => "left motor power",
            Self::GyroX => "gyro x",
            Self::GyroY => "gyro y",
            Self::GyroZ => "gyro z",
            Self::AccelerationX => "acceleration x",
            Self::AccelerationY => "acceleration y",
            Self::AccelerationZ => "acceleration z",
        }
    }

    /// The names in logs, in lower case without spaces and punctuation; the lab's first. `gryoy` is
    /// a spelling that some of its logs have.
    const fn spellings(self) -> &'static [&'static str] {
        match self {
            Self::RightLeg => &["rightlegpos", "rightlegposition", "rightleg", "rlegpos", "rleg"],
            Self::LeftLeg => &["leftlegpos", "leftlegposition", "leftleg", "llegpos", "lleg"],
            Self::RightDuty => &["dcr", "rdc", "dutyr", "rduty", "rightduty", "rightdutycycle"],
            Self::LeftDuty => &["dcl", "ldc", "dutyl", "lduty", "leftduty", "leftdutycycle"],
            Self::RightBackEmf => &["rbemf", "bemfr", "rightbemf", "rightbackemf", "rbackemf"],
            Self::LeftBackEmf => &["lbemf", "bemfl", "leftbemf", "leftbackemf", "lbackemf"],
            Self::Battery => &["vbatt", "vbat", "battv", "batt", "battery", "batteryvoltage"],
            Self::Current => &["current", "currenta", "ibatt", "ibat", "batterycurrent"],
            Self::RightCurrent => &["rcurrent", "currentr", "rightcurrent", "rightmotorcurrent"],
            Self::LeftCurrent => &["lcurrent", "currentl", "leftcurrent", "leftmotorcurrent"],
            Self::Power => &["power", "powerw", "electricalpower", "batterypower"],
            Self::RightPower => &["rpower", "powerr", "rightpower", "rightmotorpower"],
            Self::LeftPower => &["lpower", "powerl", "leftpower", "leftmotorpower"],
            Self::GyroX => &["gyrox", "gryox", "gx"],
            Self::GyroY => &["gyroy", "gryoy", "gy"],
            Self::GyroZ => &["gyroz", "gryoz", "gz"],
            Self::AccelerationX => &["ax", "accelx", "accx", "xlx"],
            Self::AccelerationY => &["ay", "accely", "accy", "xly"],
            Self::AccelerationZ => &["az", "accelz", "accz", "xlz"],
        }
    }

    /// The column of this name, given in lower case without spaces and punctuation.
    pub fn from_name(plain: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|telemetry| telemetry.spellings().contains(&plain))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_names_of_the_lab_are_known_in_any_spelling() {
        let plain = |name: &str| name.replace([' ', '_'], "").to_lowercase();
        use Telemetry::*;
        for (name, expected) in [
            ("Right Leg Pos", Some(RightLeg)),
            ("left_leg_pos", Some(LeftLeg)),
            ("Commanded Right Leg Pos", None),
            ("DCR", Some(RightDuty)),
            ("DCL", Some(LeftDuty)),
            ("GyroY", Some(GyroY)),
            ("GryoY", Some(GyroY)),
            ("AZ", Some(AccelerationZ)),
            ("RBEMF", Some(RightBackEmf)),
            ("LBEMF", Some(LeftBackEmf)),
            ("VBatt", Some(Battery)),
            ("current_a", Some(Current)),
            ("Right Motor Power", Some(RightPower)),
            ("S1", None),
        ] {
            assert_eq!(Telemetry::from_name(&plain(name)), expected, "{name}");
        }
    }

    #[test]
    fn no_spelling_is_claimed_twice() {
        let mut all: Vec<_> = Telemetry::ALL.iter().flat_map(|t| t.spellings()).collect();
        all.sort();
        assert!(all.windows(2).all(|pair| pair[0] != pair[1]));
    }
}
