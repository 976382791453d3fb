//! Heads of texts from various programs: lines that name columns and units, and the first row.

use std::path::{Path, PathBuf};

use log_file::{Log, LogError, Mapping, ReadOptions, Wanted, parse_column, parse_columns};
use shell_data::{Axis, Block};

fn open_with(text: &str, mapping: &Mapping) -> Result<Log, LogError> {
    Log::in_memory(Path::new("log.txt"), text.as_bytes().into(), mapping)
}

fn open(text: &str) -> Log {
    open_with(text, &Mapping::default()).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn rows(log: &Log) -> Block {
    let wanted = Wanted {
        time: log.has_time(),
        readings: log.channels() > 0,
        wrench: log.has_wrench(),
        ..Wanted::default()
    };
    log.read_whole(&wanted, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}")).0
}

fn said(log: &Log) -> String {
    log.decisions().join("; ")
}

fn axis(rows: &Block, axis: Axis) -> &[f64] {
    &rows.wrench[axis.index()]
}

#[test]
fn names_below_text_are_found_with_counts_and_rate() {
    let mut text = "Start Time: May 2, 2025 9:00:01 AM\nRDT Sample Rate: 500\n\
                    \"NOTE: the rate is read once, at the start.\"\nForce Units: lbf\n\
                    Counts per Unit Force: 1000.0\nTorque Units: lbf-in\nCounts per Unit Torque: 2000.0\n\
                    Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, Time\n"
        .to_owned();
    for row in 0..40 {
        let sequence = 7 * row;
        text += &format!(
            "\"0x00000000\",\"{row}\",\"{sequence}\",\"1000\",\"-2000\",\"500\",\"2000\",\"0\",\"4000\",\
             \"May 2, 2025 9:00:01 AM\"\n"
        );
    }
    let log = open(&text);
    assert_eq!(
        said(&log),
        "names from line 8; data from line 9; 500 Hz from line 2, as time; \
         forces in counts, divided by 1,000 from line 5; moments in counts, divided by 2,000 from line 7"
    );
    let rows = rows(&log);
    assert_eq!((rows.rows, rows.time_s[39]), (40, 39.0 / 500.0));
    // Allows for one rounding.
    assert!((axis(&rows, Axis::Fy)[3] + 2.0 * 4.448_221_615_260_5).abs() < 1e-14);
    // A pound-force inch is 0.1129848290276167 N·m (NIST SP 811, table B.8).
    assert!((axis(&rows, Axis::Mz)[0] - 2.0 * 0.112_984_829_027_616_7).abs() < 1e-15);
}

#[test]
fn names_units_and_rate_of_laboratory_programs_are_found() {
    let vicon = "Devices\n2000\n,,Plate 1 - Force,,,Plate 1 - Moment,,\n\
                 Frame,Sub Frame,Fx,Fy,Fz,Mx,My,Mz\n,,N,N,N,N.mm,N.mm,N.mm\n\
                 1,0,1.5,2,-700,10,20,30\n1,1,1.5,2,-701,10,20,31\n2,0,1.5,2,-702,10,20,32\n";
    let log = open(vicon);
    let expected = "names from line 4; units from line 5; data from line 6 to the next blank line; \
                    2000 Hz from line 2, as time";
    assert_eq!(said(&log), expected);
    let of = rows(&log);
    assert_eq!((axis(&of, Axis::Mz), of.time_s[2]), (&[0.030, 0.031, 0.032][..], 0.001));

    let labview = "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\n\
                   Decimal_Separator\t,\nMulti_Headings\tNo\nX_Columns\tOne\nDate\t2025/05/02\n\
                   ***End_of_Header***\t\n\t\nChannels\t3\t\t\t\nSamples\t3\t3\t3\t\n\
                   X0\t0,0\t0,0\t0,0\t\nDelta_X\t0,02\t0,02\t0,02\t\n***End_of_Header***\t\t\t\t\n\
                   X_Value\ts1\ts2\tFz\tComment\n0,00\t-1,5\t2,25\t-3,5\t\n0,02\t-1,25\t2,5\t3,5\t\n\
                   0,04\t-1,0\t2,75\t4,5\t\n";
    let log = open(labview);
    assert_eq!(said(&log), "names from line 16; data from line 17");
    let of = rows(&log);
    let found = (of.time_s[2], of.readings[0][1], axis(&of, Axis::Fz)[0]);
    assert_eq!(found, (0.04, -1.25, -3.5));

    let qualisys = "NO_OF_SAMPLES\t3\nFREQUENCY\t500\nTIME_STAMP\t2025-05-02, 09:00:00.000\t12.5\n\
                    DATA_INCLUDED\tFORCE\nFORCE_PLATE_LENGTH\t600\nFORCE_PLATE_WIDTH\t400\n\
                    SAMPLE\tTIME\tForce_X\tForce_Y\tForce_Z\tMoment_X\tMoment_Y\tMoment_Z\n\
                    1\t0.000\t1\t2\t3\t4\t5\t6\n2\t0.002\t1\t2\t3\t4\t5\t7\n3\t0.004\t1\t2\t3\t4\t5\t8\n";
    let log = open(qualisys);
    assert_eq!(said(&log), "names from line 7; data from line 8");
    assert_eq!((rows(&log).time_s[1], axis(&rows(&log), Axis::Mz)[2]), (0.002, 8.0));

    let opensim = "wrench\nversion=1\nnRows=3\nnColumns=4\ninDegrees=no\nendheader\ntime\tFx\tFy\tFz\n\
                   0.0\t1\t2\t3\n0.1\t1\t2\t4\n0.2\t1\t2\t5\n";
    let log = open(opensim);
    assert_eq!(said(&log), "names from line 7; data from line 8");
    assert_eq!(axis(&rows(&log), Axis::Fz), [3.0, 4.0, 5.0]);
}

#[test]
fn marks_and_declared_separators_before_names_are_read_over() {
    for (text, names_line) in [
        ("% t_s,s1,fz\n0.0,5,1\n0.1,6,2\n", 1),
        ("# t_s,s1,fz\n0.0,5,1\n0.1,6,2\n", 1),
        ("// t_s;s1;fz\n0,0;5;1\n0,1;6;2\n", 1),
        ("sep=;\nt_s;s1;fz\n0,0;5;1\n0,1;6;2\n", 2),
        ("\"sep=,\"\r\n\"t_s\",\"s1\",\"fz\"\r\n\"0.0\",\"5\",\"1\"\r\n\"0.1\",\"6\",\"2\"\r\n", 2),
        (
            "a recording of the third session\nwith two loads, and a spring\n\nt_s,s1,fz\n0.0,5,1\n0.1,6,2\n",
            4,
        ),
        ("operator: A, rate: none\n# rig 7\nt_s\ts1\tfz\ns\tcounts\tN\n0.0\t5\t1\n0.1\t6\t2\n", 3),
        ("# t_s s1 fz\n0.000e+00 5.000e+00 1.000e+00\n1.000e-01 6.000e+00 2.000e+00\n", 1),
        ("t_s   s1  fz\n  0.0  5   1\n  0.1  6   2\n", 1),
        ("# made by a program\n#\n# t_s s1 fz\n 0,0 5 1\n 0,1 6 2\n", 3),
    ] {
        let log = open(text);
        let of = rows(&log);
        assert_eq!(of.time_s, [0.0, 0.1], "{text}");
        assert_eq!(
            (&*of.readings[0], axis(&of, Axis::Fz)),
            (&[5.0, 6.0][..], &[1.0, 2.0][..]),
            "{text}"
        );
        let first = format!("names from line {names_line}");
        assert!(
            log.decisions().is_empty() || said(&log).contains(&first),
            "{}: {text}",
            said(&log)
        );
    }
}

#[test]
fn times_of_ros_are_nanoseconds_whatever_stands_before_their_names() {
    let text = "%time,field.header.seq,field.header.stamp,field.wrench.force.x,field.wrench.torque.z\n\
                1700000000000000000,0,1699999999999000000,1.5,0.25\n\
                1700000000010000000,1,1700000000009000000,1.5,0.5\n";
    let of = rows(&open(text));
    // A double of this magnitude has a resolution of 0.24 µs.
    assert!((of.time_s[1] - of.time_s[0] - 0.01).abs() < 1e-6);
    assert!((of.time_s[0] - 1.7e9).abs() < 1e-3);
    assert_eq!(axis(&of, Axis::Mz), [0.25, 0.5]);
}

#[test]
fn rows_with_labels_keys_or_an_arrow_are_read() {
    let plotter = open("A:18 B:12 C:-1.5\nA:15 B:13 C:2\nA:16 B:14 C:3\n");
    let names: Vec<&str> = plotter.columns().iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["A", "B", "C"]);
    let sensors = Some(vec![parse_column("B").unwrap(), parse_column("C").unwrap()]);
    let mapping = Mapping { sensors, ..Mapping::default() };
    let log =
        open_with("ready\nA:18 B:12 C:-1.5\nA:15 B:13 C:2\nA:16 B:14 C:3\n", &mapping).unwrap();
    assert_eq!(rows(&log).readings, [[12.0, 13.0, 14.0], [-1.5, 2.0, 3.0]]);

    let monitor =
        open("14:24:42.000 -> s1:1,s2:2\n14:24:42.020 -> s1:3,s2:4\n14:24:42.040 -> s1:5,s2:6\n");
    let of = rows(&monitor);
    assert_eq!(of.readings, [[1.0, 3.0, 5.0], [2.0, 4.0, 6.0]]);
    assert!((of.time_s[2] - (14.0 * 3600.0 + 24.0 * 60.0 + 42.04)).abs() < 1e-9);
    let bare = open("09:00:00.000 -> 27,28,29\n09:00:00.020 -> 30,31,32\n");
    assert_eq!((bare.columns().len(), bare.has_time(), bare.channels()), (4, true, 0));

    let stream = open(
        "{\"t_s\":0.000000,\"index\":0,\"s1\":5,\"s2\":6,\"fx_n\":1.5,\"flags\":\"untared unfiltered\"}\n\
         {\"t_s\":0.010000,\"index\":1,\"s1\":7,\"s2\":8,\"fx_n\":-2.5e-3,\"flags\":\"\"}\n",
    );
    let of = rows(&stream);
    assert_eq!((&*of.time_s, axis(&of, Axis::Fx)), (&[0.0, 0.01][..], &[1.5, -2.5e-3][..]));
    assert_eq!(of.readings, [[5.0, 7.0], [6.0, 8.0]]);
}

/// Rows in the layouts of further programs: the same times and forces in each.
#[test]
fn names_units_and_times_of_further_programs_are_found() {
    let table = |head: &str, row: &dyn Fn(usize) -> String| {
        let rows: Vec<String> = (0..40).map(row).collect();
        format!("{head}{}\n", rows.join("\n"))
    };
    let force = |at: usize| at as f64 - 20.25;
    for (what, start_s, text) in [
        (
            "NumPy, names with units",
            0.0,
            table("# time [s]  Fx [N]  Fy [N]\n", &|at| format!("{}.0 {} 1.5", at, force(at))),
        ),
        (
            "NumPy, names between commas above rows between blanks",
            0.0,
            table("# t, Fx (N), Fy (N)\n", &|at| format!("{:e} {:e} 1.5", at as f64, force(at))),
        ),
        (
            "names at wide distances",
            0.0,
            table("elapsed time   Fx N   Fy N\n", &|at| format!("{at}   {}   1.5", force(at))),
        ),
        (
            "R, write.table",
            0.0,
            table("\"t\" \"Fx (N)\" \"Fy\" \"of\"\n", &|at| {
                format!("\"{}\" {at} {} 1.5 \"pose {}\"", at + 1, force(at), at / 10)
            }),
        ),
        (
            "pandas, dates as the index",
            1_772_366_400.0,
            table(",Fx,Fy\n", &|at| format!("2026-03-01 13:00:{at:02}+01:00,{},1.5", force(at))),
        ),
        (
            "dates by another name",
            1_772_366_400.0,
            table("calibrated on,received,Fx,Fy\n", &|at| {
                format!("2025-07-01,2026-03-01 12:00:{at:02},{},1.5", force(at))
            }),
        ),
        (
            "pandas, durations as the index",
            86_400.0,
            table(",Fx,Fy\n", &|at| format!("1 days 00:00:{at:02}.000000,{},1.5", force(at))),
        ),
        (
            "PlotJuggler",
            1_700_000_000.0,
            table(
                "__time,/ft/wrench/force/x,/ft/wrench/force/y,/ft/wrench/force/z,/ft/wrench/torque/x,\
                 /ft/wrench/torque/y,/ft/wrench/torque/z\n",
                &|at| format!("{}.0,{},1.5,0,0,0,0", 1_700_000_000 + at, force(at)),
            ),
        ),
        (
            "one force plate with its number",
            0.0,
            table("Time (s)\tFx1\tFy1\tFz1\tMx1\tMy1\tMz1\n", &|at| {
                format!("{at}\t{}\t1.5\t0\t0\t0\t0", force(at))
            }),
        ),
        (
            "seconds and nanoseconds of ROS",
            1_700_000_000.5,
            table("header.stamp.sec,header.stamp.nanosec,wrench.force.x,wrench.force.y\n", &|at| {
                format!("{},500000000,{},1.5", 1_700_000_000 + at, force(at))
            }),
        ),
        (
            "seconds and nanoseconds of a simulation, at the end",
            12.25,
            table("Fx,Fy,clock.secs,clock.nsecs\n", &|at| {
                format!("{},1.5,{},250000000", force(at), 12 + at)
            }),
        ),
        (
            "LabVIEW, without a field for the comment",
            0.0,
            table(
                "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tMulti\n***End_of_Header***\t\n\t\n\
                 Channels\t2\t\t\t\n***End_of_Header***\t\t\t\nX_Value\tFx\tX_Value\tFy\tComment\t\n",
                &|at| format!("{at}.0\t{}\t{at}.0\t1.5", force(at)),
            ),
        ),
    ] {
        let log = open(&text);
        let of = rows(&log);
        assert_eq!((of.rows, of.time_s.len()), (40, 40), "{what}");
        assert_eq!((of.time_s[0], of.time_s[39]), (start_s, start_s + 39.0), "{what}");
        let found = (axis(&of, Axis::Fx)[39], axis(&of, Axis::Fy)[39]);
        assert_eq!(found, (18.75, 1.5), "{what}");
    }
}

#[test]
fn two_columns_of_dates_are_not_a_time() {
    let row = |at: usize| format!("12:00:{at:02},12:01:{at:02},{at},7\n");
    let log = open(&format!("sent,received,s1,s2\n{}", (0..40).map(row).collect::<String>()));
    assert!(!log.has_time());
}

#[test]
fn two_force_plates_are_not_one() {
    let names = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"];
    let of = |plate: usize| names.map(|name| format!("{name}{plate}")).join(",");
    let row = "1,2,3,4,5,6,1,2,3,4,5,6\n";
    // Plates 2 and 3 without plate 1 are not taken for the only plate.
    let log = open(&format!("{},{}\n{row}{row}", of(2), of(3)));
    assert!(!log.has_wrench());
}

#[test]
fn rows_without_names_are_read_below_text_by_the_numbers_of_columns() {
    let rows_of = |count: usize| -> String {
        (0..count).map(|at| format!("{at}.5,{},{}\n", 100 + at, 200 - at)).collect()
    };
    let columns = |text: &str| parse_columns(text).ok();
    let by_number =
        Mapping { time: parse_column("1").ok(), sensors: columns("2-3"), ..Mapping::default() };
    for head in ["rig 7\nby hand, at noon\n", "a,b,c,d\n", "session 3\n\n", "# rig 7\n"] {
        let text = format!("{head}{}", rows_of(20));
        let log = open_with(&text, &by_number).unwrap();
        let of = rows(&log);
        assert_eq!((of.rows, of.time_s[0], &of.readings[1][..2]), (20, 0.5, &[200.0, 199.0][..]));
        // Columns that are given by name need a line of names.
        let by_name = Mapping { sensors: columns("b,c"), ..Mapping::default() };
        let read = open_with(&text, &by_name).and_then(|log| {
            let wanted = Wanted { readings: true, ..Wanted::default() };
            log.read_whole(&wanted, &ReadOptions::default()).map(drop)
        });
        assert!(read.is_err(), "{head}");
    }
}

#[test]
fn lines_with_two_carriage_returns_are_lines() {
    let of = rows(&open("t_s,s1,fz\r\r\n0.0,5,1\r\r\n0.1,6,2\r\r\n"));
    assert_eq!((&of.time_s[..], &*of.readings[0]), (&[0.0, 0.1][..], &[5.0, 6.0][..]));
    let of = rows(&open("\"t_s\",\"s1\"\r\r\n0.0,\"5\"\r\r\n0.1,\"6\"\r\r\n"));
    assert_eq!(of.readings[0], [5.0, 6.0]);
}

#[test]
fn days_are_asked_for() {
    // 10 ms are 1.157e-7 days; 2026-03-01 is day 46082 in Excel, and 739,677 in MATLAB.
    for first in [46_082.5, 739_677.5] {
        let row = |at: usize| format!("{:.10},{at}\n", first + at as f64 * 0.01 / 86_400.0);
        let text = format!("time,s1\n{}", (0..40).map(row).collect::<String>());
        let error = open_with(&text, &Mapping::default()).unwrap_err().to_string();
        assert!(error.contains("the time unit of column `time` is not known"), "{error}");
        let units = vec![("time".to_owned(), "d".to_owned())];
        let of = rows(&open_with(&text, &Mapping { units, ..Mapping::default() }).unwrap());
        // Numbers of days have ten decimals: a resolution of 8.64 µs.
        assert!((of.time_s[39] - of.time_s[0] - 0.39).abs() < 1e-5);
    }
    // The same numbers in steps of 0.001 are seconds at 1 kHz, not days.
    assert!(open("time,s1\n46082.500,1\n46082.501,2\n46082.502,3\n").has_time());
}

#[test]
fn numbers_with_a_unit_are_rows() {
    let mapping = Mapping { wrench: log_file::parse_wrench("fz=1").ok(), ..Mapping::default() };
    let log = open_with("Tare done\n0.500 kg\n0.250 kg\n-1.000 kg\n", &mapping).unwrap();
    // Standard gravity is 9.80665 m/s².
    assert_eq!(axis(&rows(&log), Axis::Fz), [4.903_325, 2.451_662_5, -9.806_65]);
}

#[test]
fn what_is_no_table_is_refused_and_what_the_user_says_decides() {
    let talk = "hello, world\nthis is, no log\nof any, kind\n";
    let error = open_with(talk, &Mapping::default()).unwrap_err().to_string();
    assert!(error.contains("names no columns, and no rows of numbers follow"), "{error}");
    // The second line looks like names as well as the first does.
    let text = "a,b,c\nt_s,s1,fz\n0,5,1\n1,6,2\n";
    let skipped = Mapping { skip_lines: Some(2), ..Mapping::default() };
    let second = Mapping { header_line: Some(2), ..Mapping::default() };
    assert_eq!(rows(&open_with(text, &second).unwrap()).readings[0], [5.0, 6.0]);
    assert!(open_with(text, &skipped).is_err(), "the names are skipped, too");
}

#[test]
fn a_bad_first_row_is_not_taken_for_text_above() {
    for text in ["t_s,s1,fz\n0,5\n1,6,2\n2,6,2\n", "# a log\nt_s,s1,fz\n0,x\n1,6,2\n2,6,2\n"] {
        let log = open(text);
        let wanted = Wanted { readings: true, ..Wanted::default() };
        let error = log.read_whole(&wanted, &ReadOptions::default()).unwrap_err().to_string();
        assert!(error.contains("expected 3 columns, found 2"), "{error}");
    }
}

/// Reads files in the layouts of other laboratories, if they are available.
#[test]
fn cases_of_other_laboratories_are_read() {
    let Some(data) = std::env::var_os("SHELLCAL_REAL_DATA") else { return };
    let folder = PathBuf::from(data).join("../cases");
    let time = |name: &str| Mapping { time: parse_column(name).ok(), ..Mapping::default() };
    let none = Mapping::default;
    let mut wrong = Vec::new();
    for (name, mapping, count, start_s, end_s, channels, axes) in [
        ("clock-board_us.csv", time("board_us"), 80, 1.0, 1.079, 2, 1),
        (
            "clock-header.stamp.csv",
            time("header.stamp"),
            80,
            1_609_060_336.768_428,
            1_609_060_336.847_428,
            2,
            1,
        ),
        ("clock-host_time.csv", time("host_time"), 299, 1_609_060_336.768, 1_609_060_339.748, 3, 3),
        ("clock-timestamps.csv", none(), 39, 0.0, 0.38, 8, 6),
        ("preamble-ati-netft-demo.csv", none(), 192, 0.0, 1.91, 0, 6),
        ("preamble-vicon.csv", none(), 195, 0.0, 0.194, 0, 6),
        ("preamble-labview.lvm", none(), 50, 0.0, 0.49, 3, 1),
        ("preamble-qualisys.tsv", none(), 36, 0.0, 0.035, 0, 6),
        ("preamble-opensim.sto", none(), 33, 0.0, 3.2, 0, 6),
        ("blanks-savetxt.txt", none(), 30, 0.0, 2.9, 2, 1),
        ("header-percent.csv", none(), 60, 0.0, 0.59, 2, 1),
        ("header-sep.csv", none(), 60, 0.0, 0.59, 2, 1),
        ("ros1-echo.csv", none(), 199, 1_609_060_336.768_428, 1_609_060_338.748_428, 0, 6),
        ("own-stream.jsonl", none(), 200, 0.0, 1.99, 8, 6),
        ("labels-arduino-plotter.txt", none(), 60, 0.0, 0.0, 0, 0),
        ("arduino-monitor.txt", none(), 60, 51_882.0, 51_883.18, 0, 0),
        ("clock-wraps-at-32-bits.csv", none(), 600, 4_291.967_296, 4_297.957_296, 8, 6),
        ("units-lbf-row.csv", none(), 20, 0.0, 0.0, 0, 6),
        ("units-mm.N-row.csv", none(), 20, 0.0, 0.0, 0, 6),
        ("readings-signed.csv", none(), 60, 0.0, 0.59, 2, 1),
    ] {
        let log = match Log::open(&folder.join(name), &mapping) {
            Ok(log) => log,
            Err(error) => {
                wrong.push(format!("{name}: {error}"));
                continue;
            }
        };
        let of = rows(&log);
        let axes_found = log.axes().iter().count();
        let ends = of.time_s.first().copied().zip(of.time_s.last().copied()).unwrap_or_default();
        // Times since 1970 have a resolution of 0.24 µs.
        let are_times = (ends.0 - start_s).abs() < 1e-6 && (ends.1 - end_s).abs() < 1e-6;
        if (of.rows, log.channels(), axes_found) != (count, channels, axes) || !are_times {
            wrong.push(format!("{name}: {} {} {axes_found} {ends:?}", of.rows, log.channels()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_counter_in_a_table_wraps_around_as_one_in_a_text_does() {
    let counter: Vec<f64> =
        (0..3000_u32).map(|row| f64::from((u32::MAX - 9_999).wrapping_add(row * 10))).collect();
    let readings: Vec<f64> = (0..3000).map(f64::from).collect();
    let cells = [("t_us", &counter), ("s1", &readings)].map(|(name, values)| {
        (name.to_owned(), table_file::write::Cells::Full(values.as_slice().into()))
    });
    let mut table = Vec::new();
    table_file::write::write_matlab(&mut table, &cells).unwrap();
    let lines = counter.iter().zip(&readings).map(|(time, reading)| format!("{time},{reading}\n"));
    let text = open(&format!("t_us,s1\n{}", lines.collect::<String>()));
    let table = Log::in_memory(Path::new("log.mat"), table.into(), &Mapping::default()).unwrap();
    assert_eq!(table.clock_turn(), Some((4_294.967_296, "32 bits came round")));
    let expected = rows(&text.with_chunk_bytes(700)).time_s;
    assert_eq!(rows(&table.with_chunk_bytes(700)).time_s, expected);
    assert_eq!(expected[2999], (4_294_957_296.0 + 29_990.0) / 1e6);
    assert!(expected.is_sorted());
}

#[test]
fn a_date_with_two_readings_is_asked_for_where_times_are_wanted() {
    let text = "time,s1\n03/04/2026 10:00:00,1\n03/04/2026 10:00:01,2\n03/04/2026 10:00:02,3\n";
    let log = open(text);
    let times = Wanted { time: true, readings: true, ..Wanted::default() };
    let error = log.read_whole(&times, &ReadOptions::default()).map(drop).unwrap_err();
    assert!(error.to_string().contains("the date `03/04/2026 10:00:00` begins with"), "{error}");
    let readings = Wanted { readings: true, ..Wanted::default() };
    assert_eq!(log.read_whole(&readings, &ReadOptions::default()).unwrap().0.rows, 3);
    for (order, first) in [("d/m/y", 1_775_210_400.0), ("m/d/y", 1_772_618_400.0)] {
        let units = vec![("time".to_owned(), order.to_owned())];
        let log = open_with(text, &Mapping { units, ..Mapping::default() }).unwrap();
        assert_eq!(rows(&log).time_s, [first, first + 1.0, first + 2.0], "{order}");
    }
}

#[test]
fn keys_behind_comment_marks_count_above_bare_names_as_well() {
    for mark in ["# ", "// ", ""] {
        let text = format!(
            "{mark}Force Units: mN\n{mark}Torque Units: mNm\ntime,s1,Fx,Fy,Fz,Mx,My,Mz\n\
             0.01,5,1000,2000,3000,40,50,60\n0.02,6,1000,2000,3000,40,50,60\n"
        );
        let rows = rows(&open(&text));
        assert_eq!((axis(&rows, Axis::Fx)[0], axis(&rows, Axis::Mz)[1]), (1.0, 0.06), "{mark}");
    }
}

#[test]
fn units_above_the_names_and_ones_among_them_are_read() {
    let text = "time,s1,s2,Fx,Fy,Fz,Mx,My,Mz\ns,1,1,mN,mN,mN,mN.m,mN.m,mN.m\n\
                0.01,5,7,1000,2000,3000,40,50,60\n0.02,6,8,1000,2000,3000,40,50,60\n";
    let rows = rows(&open(text));
    assert_eq!((rows.rows, axis(&rows, Axis::Fy)[0], axis(&rows, Axis::My)[0]), (2, 2.0, 0.05));
    let (names, units) = ("time,s1,s2,Fx,Fy,Fz,Mx,My,Mz", "s,counts,counts,mN,mN,mN,mNm,mNm,mNm");
    let text =
        format!("{units}\n{names}\n0.01,5,7,1000,2000,3000,40,50,60\n0.02,6,8,1,2,3,4,5,6\n");
    let above = self::rows(&open(&text));
    assert_eq!((above.rows, axis(&above, Axis::Fy)[0], axis(&above, Axis::My)[0]), (2, 2.0, 0.05));
    // A row of ones is not a line of units.
    let text = "s1,s2,Fx,Fy,Fz,Mx,My,Mz\n1,1,1,1,1,1,1,1\n2,2,2,2,2,2,2,2\n";
    assert_eq!(self::rows(&open(text)).rows, 2);
}

#[test]
fn numbers_of_columns_in_place_of_names_are_no_row() {
    let row = |of: usize| {
        let number = |at: usize| if at == 0 { of } else { 50 * of + 7 * at };
        (0..15).map(|at| number(at).to_string()).collect::<Vec<_>>().join(",") + "\n"
    };
    let data: String = (1..9).map(row).collect();
    for start in [0, 1] {
        let names = (start..start + 15).map(|at| at.to_string()).collect::<Vec<_>>().join(",");
        for (columns, mapping) in [
            (8, Mapping::default()),
            (
                3,
                Mapping {
                    sensors: Some(parse_columns("2-4").unwrap()),
                    wrench: Some(std::array::from_fn(|axis| {
                        parse_column(&(10 + axis).to_string()).ok()
                    })),
                    ..Mapping::default()
                },
            ),
        ] {
            let log = open_with(&format!("{names}\n{data}"), &mapping).unwrap();
            let rows = rows(&log);
            assert_eq!((rows.rows, rows.readings.len()), (8, columns), "from {start}");
            assert_eq!(axis(&rows, Axis::Fx)[0], 113.0);
        }
    }
}

/// The times of a log's first and last row.
fn ends(log: &Log) -> (f64, f64) {
    let times = rows(log).time_s;
    (times[0], times[times.len() - 1])
}

fn refusal(text: &str) -> String {
    let read = open_with(text, &Mapping::default()).and_then(|log| {
        let wanted = Wanted {
            time: log.has_time(),
            readings: log.channels() > 0,
            wrench: log.has_wrench(),
            ..Wanted::default()
        };
        log.read_whole(&wanted, &ReadOptions { skip_bad_rows: true, ..ReadOptions::default() })
    });
    read.err().unwrap_or_else(|| panic!("{text}")).to_string()
}

fn table(head: &str, row: &dyn Fn(usize) -> String) -> String {
    head.to_owned() + &(0..40).map(|at| row(at) + "\n").collect::<String>()
}

#[test]
fn a_clock_in_several_columns_is_their_sum() {
    // `date -u -d 2026-03-21T12:00 +%s`
    let noon = 1_774_094_400.0;
    for (text, first, last) in [
        (
            table("Date,Time,Fx (N)\n", &|at| format!("2026-03-21,12:00:{at:02}.25,{at}")),
            noon + 0.25,
            noon + 39.25,
        ),
        (
            table("Datum;Uhrzeit;Fx (N)\n", &|at| format!("21.03.2026;12:00:{at:02};{at},5")),
            noon,
            noon + 39.0,
        ),
        (
            table("Date,Time,Millisecond,Fx (N)\n", &|at| {
                format!("3/21/2026,12:00:{:02},{},{at}", at / 10, at % 10 * 100)
            }),
            noon,
            noon + 3.9,
        ),
        (
            table("Datum;Uhrzeit;Millisekunden;Fx (N)\n", &|at| {
                format!("21.03.2026;12:00:{:02};{};{at},5", at / 10, at % 10 * 100)
            }),
            noon,
            noon + 3.9,
        ),
        (
            table("date,time,Fx (N)\n", &|at| {
                let (day, time) = if at < 20 { (20, "23:59") } else { (21, "00:00") };
                format!("2026-03-{day},{time}:{:02},{at}", if at < 20 { 40 + at } else { at - 20 })
            }),
            noon - 43_220.0,
            noon - 43_181.0,
        ),
        (
            table("sec,msec,Fx (N)\n", &|at| format!("{},{},{at}", 5 + at / 4, at % 4 * 250)),
            5.0,
            14.75,
        ),
        (
            table("tv_sec,tv_usec,Fx (N)\n", &|at| {
                format!("{},{},{at}", 1_700_000_000 + at / 2, at % 2 * 500_000)
            }),
            1_700_000_000.0,
            1_700_000_019.5,
        ),
        (
            table("t_sec,t_nsec,Fx (N)\n", &|at| {
                format!("{},{},{at}", at / 2, at % 2 * 500_000_000)
            }),
            0.0,
            19.5,
        ),
        // Other columns are no part of the clock.
        (table("time,ms,Fx (N)\n", &|at| format!("{at},{},{at}", at % 7)), 0.0, 39.0),
        (table("Date,Time,Fx (N)\n", &|at| format!("2026-03-21,{at}.5,{at}")), 0.5, 39.5),
    ] {
        let found = ends(&open(&text));
        // Doubles near 1.8e9 are 2.4e-7 apart.
        assert!(
            (found.0 - first).abs() < 3e-7 && (found.1 - last).abs() < 3e-7,
            "{found:?}: {text}"
        );
    }
    // Seconds are no clock if their fraction exceeds a second, because the seconds alone repeat.
    let log =
        open(&table("sec,nsec,Fx (N)\n", &|at| format!("{},{},{at}", at / 4, at * 250_000_000)));
    assert!(!log.has_time());
}

#[test]
fn names_of_times_in_words_say_their_unit() {
    for (name, last) in [
        ("epoch_ms", 0.39),
        ("Zeit in ms", 0.39),
        ("Zeit in Millisekunden", 0.39),
        ("elapsed time in milliseconds", 0.39),
        ("Temps (ms)", 0.39),
        ("unix_ms", 0.39),
        ("ms", 0.39),
        ("sensor timestamp [ms]", 0.39),
    ] {
        let text = table(&format!("{name};Fx (N)\n"), &|at| format!("{};{at}", 10 * at));
        assert_eq!(ends(&open(&text)), (0.0, last), "{name}");
    }
    // Steps of 10 are ten seconds or ten milliseconds, unless the rate tells.
    let bare = table("timestamp,Fx (N)\n", &|at| format!("{},{at}", 10 * at));
    assert!(refusal(&bare).contains("the time unit of column `timestamp` is not known"));
    let with_rate = format!("Sample Rate: 100\n{bare}");
    assert_eq!(ends(&open(&with_rate)), (0.0, 0.39));
}

#[test]
fn days_of_a_spreadsheet_become_seconds_since_1970() {
    // Day 46102.5 of Excel is 2026-03-21 at noon.
    let text = table("Time,Fx (N)\n", &|at| {
        format!("{:.11},{at}", 46_102.5 + 0.25 * at as f64 / 86_400.0)
    });
    assert!(refusal(&text).contains("the time unit of column `Time` is not known"));
    let days = vec![("time".to_owned(), "d".to_owned())];
    let log = open_with(&text, &Mapping { units: days, ..Mapping::default() }).unwrap();
    let (first, last) = ends(&log);
    assert_eq!(first, 1_774_094_400.0);
    // Numbers of days have eleven decimals: a resolution of 1e-6 s.
    assert!((last - first - 9.75).abs() < 1e-5, "{last}");
}

#[test]
fn a_group_of_columns_gives_its_axis_and_unit() {
    let row = |at: usize| format!("{at}.5,{at},2000,3000,4,5,6");
    for head in [
        "Time (s),Force (mN),,,Torque (mNm),,\n,x,y,z,x,y,z\n",
        "Time,Force,,,Torque,,\n,x,y,z,x,y,z\ns,mN,mN,mN,mNm,mNm,mNm\n",
        ",Kraft [mN],,,Drehmoment [mNm],,\nZeit,X,Y,Z,X,Y,Z\n",
        "Time (s),Plate (mN),,,Plate (mNm),,\nTime,Fx,Fy,Fz,Mx,My,Mz\n",
    ] {
        let log = open(&table(head, &row));
        let found = rows(&log);
        assert_eq!((axis(&found, Axis::Fy)[7], axis(&found, Axis::Mz)[7]), (2.0, 0.006), "{head}");
        assert_eq!(found.time_s[39], 39.5, "{head}");
    }
}

#[test]
fn dashes_below_names_are_no_names() {
    let log = open(&table("| t_s | Fx | | Fy |\n|---|---|---|---|\n", &|at| {
        format!("| {at}.5 | 1 | 2 | 3 |")
    }));
    let names: Vec<&str> = log.columns().iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["", "t_s", "Fx", "", "Fy", ""]);
}

#[test]
fn units_above_the_names_hold_for_all_columns_of_their_kind() {
    let six = |at: usize| format!("{at},1,2,3,4,5");
    for head in [
        "Units,lbs,lbs,lbs,in-lbs,in-lbs,in-lbs\nFx,Fy,Fz,Mx,My,Mz\n",
        "Units: lbf, in-lbf, mils\nFx,Fy,Fz,Mx,My,Mz\n",
        "% Force Units: lbf\n% Torque Units: lbf-in\nFx,Fy,Fz,Mx,My,Mz\n",
    ] {
        let found = rows(&open(&table(head, &six)));
        let (fy, mx) = (axis(&found, Axis::Fy)[0], axis(&found, Axis::Mx)[0]);
        // NIST SP 811, tables B.8 and B.9, times 1 and 3.
        assert!((fy - 4.448_221_615_260_5).abs() < 1e-14, "{head}: {fy}");
        assert!((mx - 3.0 * 0.112_984_829_027_616_7).abs() < 1e-14, "{head}: {mx}");
    }
    // A Net F/T box sends counts.
    let said = refusal(&table("rdt_sequence,Fx,Fy,Fz,Tx,Ty,Tz\n", &|at| {
        format!("{at},1000000,-200,3,4,5,6")
    }));
    assert!(said.contains("the unit `counts` of its force is not understood"), "{said}");
    // A unit of forces alone says nothing about moments.
    let said = refusal(&table("Units: lbf\nFx,Fy,Fz,Mx,My,Mz\n", &six));
    assert!(said.contains("the unit `lbf` of its moment is not understood"), "{said}");
    let lines = "{\"type\":\"meta\",\"rate_hz\":100,\"units\":{\"fx\":\"mN\"}}\n";
    let log = open(&table(lines, &|at| format!("{{\"fx\":{},\"s1\":7,\"s2\":{at}}}", 1000 * at)));
    let found = rows(&log);
    assert_eq!((found.rows, found.time_s[39], axis(&found, Axis::Fx)[39]), (40, 0.39, 39.0));
}

#[test]
fn a_unit_of_some_axes_is_no_unit_of_the_others() {
    for head in ["Fx (mN),Fy,Fz,s1,s2\n", "Fx,Fy,Fz,s1,s2\nmN,,,V,V\n"] {
        let said = refusal(&table(head, &|at| format!("{at},2,3,4,{at}")));
        assert!(said.contains("column `Fy` has no unit, and `Fx"), "{said}");
    }
    // Without a unit a force is in N, like the others.
    let log = open(&table("Fx (N),Fy,Fz\n", &|at| format!("{at},2,3")));
    assert_eq!(axis(&rows(&log), Axis::Fy)[0], 2.0);
}

#[test]
fn a_repeated_head_is_passed_over_and_another_one_is_refused() {
    let row = |at: usize| format!("{at}.5,10,20,{at}");
    let of = |head: &str| table(head, &row);
    for head in ["t_s,s1,s2,Fx (N)\n", "t_s,s1,s2,Fx\ns,V,V,mN\n", "\"t_s\",\"s1\",\"s2\",\"Fx\"\n"]
    {
        let text = of(head) + &of(head);
        assert_eq!(rows(&open(&text)).rows, 80, "{head}");
    }
    let savetxt = |head: &str| table(head, &|at| format!("{at}.5 10 20 {at}"));
    assert_eq!(rows(&open(&(savetxt("# t s1 s2 fx\n") + &savetxt("# t s1 s2 fx\n")))).rows, 80);
    for (first, second, line) in [
        (of("t_s,s1,s2,Fx (N)\n"), of("t_s,s2,s1,Fx (N)\n"), 42),
        (of("t_s,s1,s2,Fx (N)\n"), of("t_s,s1,s2,Fx (mN)\n"), 42),
        (of("t_s,s1,s2,Fx\ns,V,V,N\n"), of("t_s,s1,s2,Fx\ns,V,V,mN\n"), 44),
        (savetxt("# t s1 s2 fx\n"), savetxt("# t s2 s1 fx\n"), 42),
    ] {
        let said = refusal(&(first + &second));
        let expected = format!("line {line}: the names of other columns than in line 1");
        assert!(said.contains(&expected), "{said}");
    }
}

#[test]
fn an_excluded_group_must_be_there() {
    let text = table("t_s,s1,s2,group\n", &|at| format!("{at},1,2,{}", ["A", "B"][at / 20]));
    let without = |group: &str| {
        let excluded_groups = vec![group.to_owned()];
        let log = open_with(&text, &Mapping { excluded_groups, ..Mapping::default() }).unwrap();
        let wanted = Wanted { readings: true, ..Wanted::default() };
        log.read_whole(&wanted, &ReadOptions::default()).map(|(block, _)| block.rows)
    };
    assert_eq!(without("A").unwrap(), 20);
    let said = without("C").unwrap_err().to_string();
    assert!(said.contains("column `group` has no `C` to leave out"), "{said}");
}

#[test]
fn marks_between_thousands_are_left_out_and_said() {
    let text = table("Zeit;s1;s2;Fx (N)\n", &|at| {
        format!("0,{at:02};{};1.{:03},5;0,5", if at < 20 { "981" } else { "1.075" }, 10 + at)
    });
    let log = open(&text);
    assert!(said(&log).contains("marks between thousands, in `s1`, `s2`"), "{}", said(&log));
    let found = rows(&log);
    assert_eq!((found.readings[0][39], found.readings[1][39]), (1075.0, 1049.5));
    let said = refusal(&table("t_s;s1;s2\n", &|at| format!("0,{at:02};1.{:03};2.113", at + 75)));
    assert!(said.contains("line 2: column `s1`: the mark in `1.075` is decimal or"), "{said}");
}

#[test]
fn units_are_found_behind_capitals_and_in_columns_of_their_own() {
    let last = |text: &str| {
        let found = rows(&open(text));
        (found.time_s[39], axis(&found, Axis::Fx)[39])
    };
    let of = |head: &str, rest: &str| table(head, &|at| format!("{},{}{rest}", 10 * at, 1000 * at));
    for text in [
        of("timeMs,forceXmN\n", ""),
        of("time_unix_ms,fx_mn\n", ""),
        of("timeSinceStartMs,FxMN (mN)\n", "").replace("FxMN", "Fx"),
        of("time (ms),fx,unit\n", ",mN"),
        of("t_ms,Fx (mN); RAW\n", ""),
        table("", &|at| format!("t_ms:{} Fx:{}mN", 10 * at, 1000 * at)),
    ] {
        assert_eq!(last(&text), (0.39, 39.0), "{text}");
    }
    // A cycle time and a duration are no clock.
    for name in ["cycleTimeMs", "dead time (ms)", "time_of_flight_ms"] {
        assert!(!open(&of(&format!("{name},fx_mn\n"), "")).has_time(), "{name}");
    }
}

#[test]
fn lists_of_a_wrench_are_its_axes() {
    for names in [
        "wrench1,wrench2,wrench3,wrench4,wrench5,wrench6",
        "observation.wrench.0,observation.wrench.1,observation.wrench.2,observation.wrench.3,\
         observation.wrench.4,observation.wrench.5",
        "force1,force2,force3,torque1,torque2,torque3",
        "force[0],force[1],force[2],torque[0],torque[1],torque[2]",
    ] {
        let log = open(&table(&format!("t_s,{names}\n"), &|at| format!("{at},1,2,3,4,5,6")));
        let found = rows(&log);
        assert_eq!((axis(&found, Axis::Fy)[0], axis(&found, Axis::Mz)[0]), (2.0, 6.0), "{names}");
    }
    // Six load cells are no wrench.
    let log = open(&table("t_s,force1,force2,force3,force4,force5,force6\n", &|at| {
        format!("{at},1,2,3,4,5,6")
    }));
    assert!(!log.has_wrench());
}

#[test]
fn one_object_of_lists_is_no_row() {
    let list = (0..40).map(|at| at.to_string()).collect::<Vec<_>>().join(",");
    let said = refusal(&format!("{{\"t\":[{list}],\"fx\":[{list}]}}\n"));
    assert!(said.contains("is a JSON document, which is not read"), "{said}");
    let octave = |name: &str| {
        format!("# name: {name}\n# type: matrix\n# rows: 2\n# columns: 1\n 1\n 2\n\n\n")
    };
    let said = refusal(&format!("# Created by Octave 8.4.0\n{}{}", octave("t"), octave("s")));
    assert!(said.contains("is text of Octave with several variables"), "{said}");
}
