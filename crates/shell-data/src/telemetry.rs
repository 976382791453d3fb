//! The columns of a robot's telemetry and their usual names.

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Telemetry {
    RightLeg,
    LeftLeg,
    RightDuty,
    LeftDuty,
    RightBackEmf,
    LeftBackEmf,
    Battery,
    /// Current of both motors, or of the whole robot.
    Current,
    RightCurrent,
    LeftCurrent,
    /// Electrical power of both motors, or of the whole robot.
    Power,
    RightPower,
    LeftPower,
    GyroX,
    GyroY,
    GyroZ,
    AccelerationX,
    AccelerationY,
    AccelerationZ,
}

/// A name for messages, and names in logs in lower case without spaces and punctuation; the lab's names come first.
/// `gryoy` is a misspelling in some of the lab's logs.
const COLUMNS: [(Telemetry, &str, &str); 19] = {
    use Telemetry::*;
    [
        (RightLeg, "right leg position", "rightlegpos rightlegposition rightleg rlegpos rleg"),
        (LeftLeg, "left leg position", "leftlegpos leftlegposition leftleg llegpos lleg"),
        (RightDuty, "right motor duty", "dcr rdc dutyr rduty rightduty rightdutycycle"),
        (LeftDuty, "left motor duty", "dcl ldc dutyl lduty leftduty leftdutycycle"),
        (RightBackEmf, "right back EMF", "rbemf bemfr rightbemf rightbackemf rbackemf"),
        (LeftBackEmf, "left back EMF", "lbemf bemfl leftbemf leftbackemf lbackemf"),
        (Battery, "battery", "vbatt vbat battv batt battery batteryvoltage"),
        (Current, "current", "current currenta ibatt ibat batterycurrent"),
        (RightCurrent, "right motor current", "rcurrent currentr rightcurrent rightmotorcurrent"),
        (LeftCurrent, "left motor current", "lcurrent currentl leftcurrent leftmotorcurrent"),
        (Power, "power", "power powerw electricalpower batterypower"),
        (RightPower, "right motor power", "rpower powerr rightpower rightmotorpower"),
        (LeftPower, "left motor power", "lpower powerl leftpower leftmotorpower"),
        (GyroX, "gyro x", "gyrox gryox gx"),
        (GyroY, "gyro y", "gyroy gryoy gy"),
        (GyroZ, "gyro z", "gyroz gryoz gz"),
        (AccelerationX, "acceleration x", "ax accelx accx xlx"),
        (AccelerationY, "acceleration y", "ay accely accy xly"),
        (AccelerationZ, "acceleration z", "az accelz accz xlz"),
    ]
};

/// The unit of telemetry whose scale is in the robot's profile.
pub const COUNTS: &str = "counts";

/// Returns true if a log means counts by this unit.
pub fn are_counts(unit: &str) -> bool {
    const WORDS: [&str; 8] = ["count", COUNTS, "cts", "raw", "adc", "lsb", "bits", "ticks"];
    WORDS.contains(&unit.to_lowercase().as_str())
}

impl Telemetry {
    /// Columns from which the electrical power of the motors is computed.
    pub const MOTORS: [Self; 5] =
        [Self::RightDuty, Self::LeftDuty, Self::RightBackEmf, Self::LeftBackEmf, Self::Battery];

    pub const fn name(self) -> &'static str {
        COLUMNS[self as usize].1
    }

    /// Finds a column by its name in lower case, without spaces and punctuation.
    pub fn from_name(plain: &str) -> Option<Self> {
        let is_named = |spellings: &str| spellings.split(' ').any(|spelling| spelling == plain);
        COLUMNS.into_iter().find(|(_, _, spellings)| is_named(spellings)).map(|(column, ..)| column)
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
        let mut all: Vec<_> = COLUMNS.iter().flat_map(|(.., names)| names.split(' ')).collect();
        all.sort();
        assert!(all.windows(2).all(|pair| pair[0] != pair[1]));
    }
    #[test]
    fn columns_are_listed_in_their_order() {
        assert!((0..COLUMNS.len()).all(|at| COLUMNS[at].0 as usize == at));
    }
}
