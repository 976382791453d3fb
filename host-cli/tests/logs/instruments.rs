//! The table of instruments in `docs/logs.md`: each command runs on a small file of that layout.

use std::fs;
use std::path::Path;

use system_tests::program;

/// Writes files by the table's names, with the lines that their programs write above the rows.
fn write_files(dir: &Path) {
    let load = |row: usize| (row % 7) as f64 - 3.0;
    let six = |row: usize, separator: &str| {
        let of = |axis: usize| format!("{:.4}", load(row + axis));
        (0..6).map(of).collect::<Vec<_>>().join(separator)
    };
    let eight = |row: usize, separator: &str| {
        let of = |channel: usize| (1500 + (row * (channel + 3)) % 97).to_string();
        (0..8).map(of).collect::<Vec<_>>().join(separator)
    };
    let table = |head: &str, row: &dyn Fn(usize) -> String| {
        let rows: String = (0..40).map(|at| row(at) + "\n").collect();
        format!("{head}{rows}")
    };
    let channels = "s1,s2,s3,s4,s5,s6,s7,s8";
    for (name, text) in [
        (
            "ati.csv",
            table(
                "Start Time: May 2, 2025 9:00:01 AM\nRDT Sample Rate: 500\nForce Units: N\n\
                 Counts per Unit Force: 1000.0\nTorque Units: Nm\nCounts per Unit Torque: 1000.0\n\
                 Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, Time\n",
                &|at| format!("0x0,{at},{at},{},May 2 9:00 AM", six(at, ",")),
            ),
        ),
        (
            "vicon.csv",
            table(
                "Devices\n1000\n,,Plate - Force,,,Plate - Moment,,\nFrame,Sub Frame,Fx,Fy,Fz,Mx,My,Mz\n\
                 ,,N,N,N,N.mm,N.mm,N.mm\n",
                &|at| format!("{at},0,{}", six(at, ",")),
            ),
        ),
        (
            "qualisys.tsv",
            table(
                "NO_OF_SAMPLES\t40\nFREQUENCY\t100\nDESCRIPTION\tKistler\n\
                 SAMPLE\tTIME\tForce_X\tForce_Y\tForce_Z\tMoment_X\tMoment_Y\tMoment_Z\n",
                &|at| format!("{at}\t{:.2}\t{}", at as f64 / 100.0, six(at, "\t")),
            ),
        ),
        (
            "grf.sto",
            table(
                "wrench\nversion=1\nnRows=40\nnColumns=7\nendheader\ntime\tFx\tFy\tFz\tMx\tMy\tMz\n",
                &|at| format!("{:.2}\t{}", at as f64 / 100.0, six(at, "\t")),
            ),
        ),
        (
            "run.lvm",
            table(
                "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\n***End_of_Header***\t\n\t\n\
                 Channels\t2\t\t\nDelta_X\t0,01\t0,01\t\n***End_of_Header***\t\t\t\n\
                 X_Value\ts1\ts2\tComment\n",
                &|at| format!("0,{at:02}\t{},5\t{},25\t", 1500 + at, 1600 - at),
            ),
        ),
        (
            "savetxt.txt",
            table("# t s1 s2 fz\n", &|at| {
                format!(
                    "{:.18e} {:.18e} {:.18e} {:.18e}",
                    at as f64,
                    1500.0,
                    1600.0 + at as f64,
                    load(at)
                )
            }),
        ),
        (
            "echo.csv",
            table(
                "%time,field.header.stamp,field.wrench.force.x,field.wrench.force.y,field.wrench.force.z,\
             field.wrench.torque.x,field.wrench.torque.y,field.wrench.torque.z\n",
                &|at| {
                    let time = 1_700_000_000_000_000_000_u64 + 10_000_000 * at as u64;
                    format!("{time},{time},{}", six(at, ","))
                },
            ),
        ),
        (
            "stream.jsonl",
            table("", &|at| {
                let time = at as f64 / 100.0;
                format!("{{\"t_s\":{time},\"s1\":{},\"s2\":7,\"fx_n\":{}}}", 1500 + at, load(at))
            }),
        ),
        (
            "ros2.csv",
            table("", &|at| format!("1700000000,{},ft_link,{}", 20_000_000 * at, six(at, ","))),
        ),
        (
            "plotjuggler.csv",
            table(
                "__time,/ft/wrench/force/x,/ft/wrench/force/y,/ft/wrench/force/z,/ft/wrench/torque/x,\
                 /ft/wrench/torque/y,/ft/wrench/torque/z\n",
                &|at| format!("{:.2},{}", 1.7e9 + at as f64 / 50.0, six(at, ",")),
            ),
        ),
        (
            "untitled.csv",
            table("rig 7, session 3\nby hand\n", &|at| {
                format!("{:.2},{}", at as f64 / 50.0, eight(at, ","))
            }),
        ),
        (
            "index.csv",
            table(&format!(",{channels}\n"), &|at| {
                format!("2026-03-01 14:24:42.{:03}000+00:00,{}", 20 * at, eight(at, ","))
            }),
        ),
        (
            "r.txt",
            table("\"t\" \"Fx\" \"Fy\" \"Fz\" \"Mx\" \"My\" \"Mz\"\n", &|at| {
                format!("\"{}\" {:.2} {}", at + 1, at as f64 / 50.0, six(at, " "))
            }),
        ),
        ("scale.txt", table("Tare done\n", &|at| format!("{:.3} kg", load(at)))),
        ("plotter.txt", table("", &|at| format!("A:{} B:{}", 1500 + at, 1600 - at))),
        (
            "monitor.txt",
            table("", &|at| format!("14:24:42.{:03} -> {},{}", 20 * at, 1500 + at, 1600 - at)),
        ),
        (
            "data.log",
            table("", &|at| format!("{at} {:.2} {}", 1.4e9 + at as f64 / 100.0, six(at, " "))),
        ),
        (
            "kistler.txt",
            table(
                "BioWare(R) Version 5.3.0.7\nSamples/channel:\t40\n\nabs time (s)\tFx\tFy\tFz\tMx\tMy\tMz\n\
                 s\tN\tN\tN\tN·m\tN·m\tN·m\n",
                &|at| format!("{:.2}\t{}", at as f64 / 100.0, six(at, "\t")),
            ),
        ),
        (
            "grf.mot",
            table(
                "grf\nversion=1\nendheader\ntime\tground_force_vx\tground_force_vy\tground_force_vz\t\
                 ground_torque_x\tground_torque_y\tground_torque_z\n",
                &|at| format!("{:.2}\t{}", at as f64 / 100.0, six(at, "\t")),
            ),
        ),
        ("ft300.txt", table("", &|at| format!("( {} )", six(at, " , ")))),
        (
            "hx711.txt",
            table("HX711 calibration sketch\nRemove all weight from scale\n", &|at| {
                format!("Reading: {:.1} lbs calibration_factor: -7050.00", load(at))
            }),
        ),
        (
            "putty.log",
            table(
                &format!(
                    "=~=~=~= PuTTY log 2026.03.01 10:22:33 =~=~=~=\n03,1987,2010\nt_ms,{channels}\n"
                ),
                &|at| format!("{},{}", 10 * at, eight(at, ",")),
            ),
        ),
        (
            "teraterm.log",
            table("", &|at| {
                format!("[2026-03-01 14:24:42.{:03}] {},{}", 20 * at, 1500 + at, 1600 - at)
            }),
        ),
        (
            "timetable.csv",
            table("Time,Fx,Fy,Fz,Mx,My,Mz\n", &|at| {
                format!("01-Mar-2026 14:24:42.{:03},{}", 20 * at, six(at, ","))
            }),
        ),
        (
            "plates.csv",
            table(
                "Devices\n1000\n,,Plate - Force,,,Plate - Moment,,\nFrame,Sub Frame,Fx,Fy,Fz,Mx,My,Mz\n\
                 ,,N,N,N,N.mm,N.mm,N.mm\n",
                &|at| match at {
                    20 => "\nTrajectories\n100\n,,LASI,,,RASI,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z"
                        .to_owned(),
                    _ => format!("{at},0,{}", six(at, ",")),
                },
            ),
        ),
        (
            "units.lvm",
            table(
                "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tNo\n\
                 ***End_of_Header***\t\n\t\nChannels\t2\t\t\nY_Unit_Label\tlbf\tlbf-in\t\nDelta_X\t0.01\t0.01\t\n\
                 ***End_of_Header***\t\t\t\nX_Value\tFx\tMx\tComment\n",
                &|at| format!("\t{:.3}\t{:.3}\t", load(at), load(at + 1)),
            ),
        ),
        (
            "midnight.csv",
            table(&format!("time,{channels}\n"), &|at| match at {
                0..20 => format!("23:59:{:02},{}", 40 + at, eight(at, ",")),
                _ => format!("00:00:{:02},{}", at - 20, eight(at, ",")),
            }),
        ),
        (
            "trailing.csv",
            table(&format!("t_s,{channels}\n"), &|at| format!("{at},{},", eight(at, ","))),
        ),
        (
            "pounds.csv",
            table("t_s,Fx (lbf),Fy (lbf),Fz (lbf),Tx (lbf-in),Ty (lbf-in),Tz (lbf-in)\n", &|at| {
                format!("{},{}", at as f64 / 100.0, six(at, ","))
            }),
        ),
        (
            "unnamed.csv",
            table("t_s,Fx,Fy,Fz,Mx,My,Mz\n", &|at| {
                format!("{},{}", at as f64 / 100.0, six(at, ","))
            }),
        ),
        (
            "board.csv",
            table(&format!("board_us,{channels}\n"), &|at| {
                format!("{},{}", 1_000_000 + 1000 * at, eight(at, ","))
            }),
        ),
        (
            "two.csv",
            table(&format!("time_s,name,{channels}\n"), &|at| {
                let name = ["A", "B"][at % 2];
                format!("{:.3},{name},{}", at as f64 / 1000.0, eight(at, ","))
            }),
        ),
        (
            "titled.csv",
            table(&format!("rig 7, session 3\nby hand, at noon\nt_s,{channels}\n"), &|at| {
                format!("{:.3},{}", at as f64 / 1000.0, eight(at, ","))
            }),
        ),
    ] {
        fs::write(dir.join(name), text).unwrap();
    }
    // A spreadsheet on Windows writes `µ` and `·` as single bytes.
    let german = table("Datum;Fx [N];Mx [N·m]\r\n", &|at| {
        format!("1.3.2026 14:24:{at:02};{};{}\r", load(at), load(at)).replace("-", "-0,")
    });
    let bytes: Vec<u8> = german.chars().map(|c| u8::try_from(c).unwrap()).collect();
    fs::write(dir.join("german.csv"), bytes).unwrap();
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates/log-file/fuzz/seeds");
    for (seed, name) in [
        ("tdms/waveform.tdms", "run.tdms"),
        ("tdms/cards.tdms", "cards.tdms"),
        ("ods/libreoffice.ods", "run.ods"),
        ("rosbag/lz4.bag", "run.bag"),
        ("sqlite/bag.db3", "run.db3"),
    ] {
        fs::copy(seeds.join(seed), dir.join(name)).unwrap();
    }
}

#[test]
fn every_command_of_the_table_of_instruments_runs() {
    let dir = tempfile::tempdir().unwrap();
    write_files(dir.path());
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/logs.md");
    let page = fs::read_to_string(page).unwrap();
    let (_, table) = page.split_once("## Instruments and programs").unwrap();
    let table = table.split("\n## ").next().unwrap();
    let commands = table.lines().filter_map(|line| {
        let (_, rest) = line.rsplit_once("`shellcal ")?;
        Some(rest.split_once('`')?.0)
    });
    let commands: Vec<&str> = commands.collect();
    assert!(commands.len() >= 14, "{commands:?}");
    for command in commands {
        program::run(dir.path(), command, 0);
    }
}

#[test]
fn decisions_about_the_head_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    write_files(dir.path());
    for (command, expected) in [
        (
            "info ati.csv",
            &["names from line 7", "data from line 8", "500 Hz from line 2", "divided by 1,000 "][..],
        ),
        (
            "info vicon.csv",
            &["names from line 4", "units from line 5", "1000 Hz from line 2", "from N·mm"],
        ),
        ("info savetxt.txt", &["columns between blanks", "no unit, taken as N: fz"]),
        ("info pounds.csv", &["Fx (N, from lbf)", "Mz (N·m, from lbf·in)"]),
        ("info unnamed.csv", &["no unit, taken as N and N·m: Fx, Fy, Fz, Mx, My, Mz"]),
        ("info board.csv --time board_us", &["1000.00 Hz", "1.000000 s to 1.039000 s"]),
        (
            "info two.csv",
            &["rows of several sensors alternate, by `name`: `A`, `B`", "--where 'name=A'"],
        ),
        ("info two.csv --where name=B", &["rows      20", "500.00 Hz"]),
        ("info kistler.txt", &["units from line 5", "time (s)", "100.00 Hz"]),
        ("info hx711.txt --wrench fz=1", &["lines of labels and values", "Fz (N, from lbf)"]),
        ("info timetable.csv", &["1772375082.000000 s", "50.00 Hz"]),
        ("info german.csv", &["1.00 Hz", "Mx (N·m)"]),
        (
            "info midnight.csv",
            &["1.00 Hz", "midnight passed at 86400.000000 s", "86380.000000 s to 86419"],
        ),
        ("info trailing.csv", &["rows      40", "sensor 8"]),
        (
            "info plates.csv",
            &[
                "Vicon export",
                "data from line 6 to the next blank line",
                "rows      20",
                "1000 Hz from line 2",
            ],
        ),
        (
            "info units.lvm",
            &[
                "LabVIEW measurement file",
                "units from line 8",
                "Fx (N, from lbf)",
                "Mx (N·m, from lbf·in)",
                "100 Hz",
            ],
        ),
        ("info run.lvm", &["LabVIEW measurement file", "names from line 9", "100.00 Hz"]),
        ("info stream.jsonl", &["JSON lines", "names from the keys of each line"]),
        (
            "info ros2.csv --time 1 --wrench 4-9",
            &["50.00 Hz", "time is the sum of `column 1` and `column 2`", "Mz (N·m)"],
        ),
        ("info plotjuggler.csv", &["50.00 Hz", "Fx (N)", "Mz (N·m)"]),
        ("info untitled.csv --time 1 --sensors 2-9", &["50.00 Hz", "sensor 8", "data from line 3"]),
        ("info index.csv", &["50.00 Hz", "1772375082.000000 s"]),
        ("info r.txt", &["50.00 Hz", "Mz (N·m)"]),
        ("info scale.txt --wrench fz=1", &["Fz (N, from kgf)"]),
        (
            "info run.ods",
            &["OpenDocument spreadsheet", "read from sheet `run`", "rows      24", "100.00 Hz"],
        ),
        ("info cards.tdms", &["rows      24", "100.00 Hz", "sensor 8"]),
        ("info run.tdms", &["TDMS file", "rows      24", "100.00 Hz", "Mx (N·m)"]),
        ("info run.db3", &["rows      24", "sensor 8", "Mx (N·m)"]),
        ("info unnamed.csv --unit force=kN", &["Fx (N, from kN)", "taken as N·m: Mx, My, Mz"]),
    ] {
        let text = program::run(dir.path(), command, 0);
        for part in expected {
            assert!(text.contains(part), "`{command}`: no `{part}` in\n{text}");
        }
    }
    let volts =
        fs::read_to_string(dir.path().join("pounds.csv")).unwrap().replace("lbf)", "volts)");
    fs::write(dir.path().join("volts.csv"), volts).unwrap();
    let said = program::run(dir.path(), "info volts.csv", 2);
    assert!(said.contains("the unit `volts` of its force is not understood"), "{said}");
    assert!(said.contains("--unit 'Fx (volts)=UNIT'"), "{said}");
    program::run(dir.path(), "info volts.csv --unit force=N,moment=N·m", 0);
}

#[test]
fn many_wrong_rows_are_skipped_only_on_request() {
    let dir = tempfile::tempdir().unwrap();
    let row = |at: usize| match at % 4 {
        0 => format!("{at},x,2\n"),
        _ => format!("{at},1,2\n"),
    };
    let text = format!("t_s,s1,s2\n{}", (1..80).map(row).collect::<String>());
    fs::write(dir.path().join("log.csv"), text).unwrap();
    let said = program::run(dir.path(), "info log.csv --skip-bad-rows", 2);
    let expected = "19 of 79 rows are wrong, all in column `s1`; the first at line 5: column 2 (`s1`): expected a number, found `x`";
    assert!(said.replace("\n", " ").contains(expected), "{said}");
    let said = program::run(dir.path(), "info log.csv --skip-bad-rows=all", 0);
    assert!(said.contains("19 bad rows"), "{said}");
}
