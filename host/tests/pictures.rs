//! What the pictures and the CSV file say of a wire on which nothing is.

use std::path::PathBuf;
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

/// An AMT node only replies: from a silent ECU on nothing is on that wire. A ZK node sends by itself.
#[test]
fn a_wire_on_which_nothing_is_carries_no_throttle() {
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
