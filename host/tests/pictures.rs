//! Checks that the pictures are readable, and how they and the CSV file show a silent wire.

#[path = "support/picture.rs"]
mod picture;

use std::path::{Path, PathBuf};
use std::process::Command;

/// Plays a run, with its CSV file and its picture.
fn played(name: &str, args: &[&str]) -> (String, String) {
    let path = |end| PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.{end}"));
    let (csv, svg) = (path("csv"), path("svg"));
    let output = Command::new(env!("CARGO_BIN_EXE_jetlink"))
        .args(["rig", "--fast"])
        .args(args)
        .args(["--csv".as_ref(), csv.as_os_str(), "--plot".as_ref(), svg.as_os_str()])
        .output()
        .expect("it runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read = |path| std::fs::read_to_string(path).expect("written");
    (read(csv), read(svg))
}

/// The throttle on the wire of an engine from one time to another.
fn throttle_on_wire(csv: &str, engine: &str, from: f64, to: f64) -> Vec<String> {
    let mut csv = csv::Reader::from_reader(csv.as_bytes());
    let heads = csv.headers().expect("heads").clone();
    let place = |head: &str| heads.iter().position(|other| other == head).expect("a column");
    let [t, name, wire] = ["t_s", "engine", "wire_throttle_pct"].map(place);
    let of_engine = |row: &csv::StringRecord| {
        let at: f64 = row[t].parse().expect("seconds");
        &row[name] == engine && at >= from && at <= to
    };
    let rows = csv.records().map(|row| row.expect("a row")).filter(of_engine);
    rows.map(|row| row[wire].to_owned()).collect()
}

/// An AMT node only replies: from a silent ECU on nothing is on that wire. A ZK node sends unprompted.
#[test]
fn no_throttle_is_shown_while_nothing_is_sent() {
    let (csv, svg) = played("engine-lost", &["--scenario", "engine-lost"]);
    // The line to left is cut at 60.2 s and joined at 70.1 s.
    let left = throttle_on_wire(&csv, "left", 60.8, 70.0);
    assert!(left.len() > 90 && left.iter().all(String::is_empty), "{left:?}");
    for (engine, from, to) in [("left", 55.0, 60.0), ("right", 55.0, 75.0)] {
        let sent = throttle_on_wire(&csv, engine, from, to);
        assert!(sent.len() >= 50 && sent.iter().all(|sent| sent == "60.0"), "{engine}: {sent:?}");
    }
    let xml = roxmltree::Document::parse(&svg).expect("well-formed XML");
    let texts: Vec<&str> =
        xml.descendants().filter(|node| node.is_text()).filter_map(|node| node.text()).collect();
    assert_eq!(texts.iter().filter(|text| text.contains("on the wire: nothing")).count(), 1, "{texts:?}");
}

/// The pictures of docs/, but those of the screen: their texts have given widths.
fn drawings() -> Vec<PathBuf> {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    let folders = [docs.clone(), docs.join("scenarios")];
    let entries = folders.iter().flat_map(|folder| std::fs::read_dir(folder).expect("a folder"));
    let paths = entries.map(|entry| entry.expect("an entry").path());
    paths.filter(|path| path.extension().is_some_and(|end| end == "svg")).collect()
}

#[test]
fn each_text_of_the_pictures_can_be_read_and_is_where_it_belongs() {
    let drawings = drawings();
    assert!(drawings.len() >= 16, "{drawings:?}");
    let found = drawings.iter().flat_map(|path| {
        let svg = std::fs::read_to_string(path).expect("a picture");
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let what = picture::hard_to_read(&svg).into_iter().chain(picture::false_names(&svg));
        what.map(move |what| format!("{name}: {what}")).collect::<Vec<_>>()
    });
    let found: Vec<String> = found.collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn what_makes_a_text_hard_to_read_is_found() {
    let picture = |elements: &str| {
        let svg = format!("<svg viewBox=\"0 0 200 100\">{elements}</svg>");
        picture::hard_to_read(&svg).join("; ")
    };
    let text = |x: u32, text: &str| format!("<text x=\"{x}\" y=\"50\" font-size=\"10\">{text}</text>");
    let frame = "<rect x=\"10\" y=\"10\" width=\"50\" height=\"80\" stroke=\"red\"/>";
    let line = |points: &str, color: &str| format!("<polyline points=\"{points}\" stroke=\"{color}\"/>");
    for (elements, expected) in [
        (text(20, "short"), ""),
        (text(180, "short"), "runs out of the picture"),
        (text(20, "short") + frame, ""),
        (text(40, "short") + frame, "runs out of a box"),
        (text(20, "short") + &text(50, "other"), ""),
        (text(20, "short") + &text(40, "other"), "overlap"),
        (text(20, "short") + &line("0,0 35,60 100,60", "red"), "crossed by the line from (0.0, 0.0)"),
        (text(20, "short") + &line("0,60 100,60", "red"), ""),
        (text(20, "short") + "<path d=\"M30 0L30 99\" stroke=\"blue\"/>", "crossed by the line from (30.0"),
        // A line of the grid.
        (text(20, "short") + &line("0,48 100,48", "#dddddd"), ""),
    ] {
        let found = picture(&elements);
        assert!(found.contains(expected) && found.is_empty() == expected.is_empty(), "{elements}: {found}");
    }
}

#[test]
fn what_is_named_falsely_is_found() {
    let picture = |elements: &str| picture::false_names(&format!("<svg>{elements}</svg>")).join("; ");
    let text =
        |x: u32, y: u32, text: &str| format!("<text x=\"{x}\" y=\"{y}\" font-size=\"13\">{text}</text>");
    let name = |x| text(x, 100, "nothing received");
    let rect = |x: u32, width: u32, height: u32, fill: &str| {
        format!("<rect x=\"{x}\" y=\"0\" width=\"{width}\" height=\"{height}\" fill=\"{fill}\"/>")
    };
    let gap = rect(300, 20, 180, "#c9c9c9");
    let leader = "<polyline points=\"398,96 316,96\"/>";
    let more = text(500, 20, "1 more marked without a name: no room");
    for (elements, expected) in [
        (gap.clone() + &name(305), ""),
        (gap.clone() + &name(323), ""),
        (gap.clone() + &name(400) + leader, ""),
        (gap.clone() + &name(400), "is at no gap; the gap at x = 300 has no name"),
        (gap.clone(), "the gap at x = 300 has no name"),
        (gap + &more, ""),
        (rect(300, 3, 180, "#c9c9c9"), ""),
        // On the wire, in the dark.
        (rect(300, 20, 18, "#3d444d"), ""),
        (rect(300, 200, 330, "#eeeeee"), "the stage from x = 300 to 500 has no name"),
        (rect(300, 200, 330, "#eeeeee") + &text(400, 320, "steps"), ""),
        (rect(300, 200, 330, "#eeeeee") + &text(480, 320, "steps"), "has no name"),
        (text(1200, 100, "75 %"), "`75 %` runs out of the plot"),
    ] {
        let found = picture(&elements);
        assert!(found.contains(expected) && found.is_empty() == expected.is_empty(), "{elements}: {found}");
    }
}

/// Faults by key, whose names have no room at their gaps.
#[test]
fn names_of_gaps_and_stages_belong_to_them() {
    let script = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("names.txt");
    let lines = [
        "jetlink rig script, version 0.1.0",
        "engine name=left,ecu=amt,engine=olympus,baud=2400",
        "engine name=z,ecu=zk",
        "10 all arm",
        "10.1 all start",
        "60 left throttle 60",
        "70 left cut",
        "72 left mend",
        "80 left flame-out",
        "90 z throttle 50",
        "100 z cut-to-node",
        "106 z mend-to-node",
        "110 all node-reset",
        "120 all standby",
        "230 end",
    ];
    std::fs::write(&script, lines.join("\n")).expect("written");
    let script = script.to_str().expect("a path");
    let played_txt = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/captures/played.txt");
    let played_txt = played_txt.to_str().expect("a path");
    for (name, args, gaps, stages) in [
        ("names", &["--script", script][..], 4, &["played"][..]),
        ("names-played", &["--script", played_txt], 1, &["played"]),
        ("names-long", &["--duration", "30m"], 0, &["steps", "steps", "steps", "steps"]),
    ] {
        let (_, svg) = played(name, args);
        let found: Vec<String> =
            picture::hard_to_read(&svg).into_iter().chain(picture::false_names(&svg)).collect();
        assert!(found.is_empty(), "{name}: {}", found.join("\n"));
        let count = |text: &str| svg.matches(&format!(">{text}</text>")).count();
        assert!(count("nothing received") >= gaps, "{name}: {}", count("nothing received"));
        for stage in stages {
            let expected = stages.iter().filter(|other| *other == stage).count();
            assert!(count(stage) >= expected, "{name}: {stage}: {}", count(stage));
        }
    }
}
