//! The files that `jetlink rig` writes, and readers that stop reading.
#![cfg(unix)]

#[path = "support/process.rs"]
mod process;
#[path = "support/wait.rs"]
mod wait;

use process::Running;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::Duration;

/// The most that anything here may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_jetlink"));
    command.arg("rig").args(args).stdin(Stdio::null());
    command
}

fn rig(args: &[&str]) -> Output {
    command(args).output().expect("it runs")
}

/// A folder of its own, empty.
fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder); // of an earlier test
    fs::create_dir_all(&folder).expect("a folder");
    folder
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("UTF-8")
}

/// One sentence, and this status.
#[track_caller]
fn refused(output: &Output, status: i32) -> String {
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{error}");
    assert_eq!((error.lines().count(), text(&output.stdout)), (1, String::new()), "{error}");
    error
}

#[test]
fn no_file_is_touched_when_one_of_them_cannot_be_written() {
    let folder = folder("untouched");
    let existing = folder.join("keep.csv");
    fs::write(&existing, "precious").unwrap();
    let output = rig(&["--fast", "--csv", existing.to_str().unwrap(), "--plot", "/nonexistent/x.svg"]);
    assert!(refused(&output, 1).contains("cannot write /nonexistent/x.svg: "));
    assert_eq!(fs::read_to_string(&existing).unwrap(), "precious");
    let new = folder.join("new.csv");
    let output = rig(&["--fast", "--csv", new.to_str().unwrap(), "--plot", "/nonexistent/x.svg"]);
    refused(&output, 1);
    assert!(!new.exists());
}

#[test]
fn the_csv_file_stays_when_a_capture_cannot_be_written() {
    let folder = folder("capture-blocked");
    let (existing, capture) = (folder.join("keep.csv"), folder.join("capture"));
    fs::write(&existing, "precious").unwrap();
    fs::create_dir_all(capture.join("right-from-ecu.bin")).unwrap();
    let left = capture.join("left-from-ecu.bin");
    fs::write(&left, "bytes").unwrap();
    let args = ["--fast", "--csv", existing.to_str().unwrap(), "--capture", capture.to_str().unwrap()];
    let error = refused(&rig(&args), 1);
    assert!(error.contains("right-from-ecu.bin: "), "{error}");
    assert_eq!(fs::read_to_string(&existing).unwrap(), "precious");
    assert_eq!(fs::read_to_string(&left).unwrap(), "bytes");
    // A folder that cannot be made.
    let args = ["--fast", "--csv", existing.to_str().unwrap(), "--capture", left.to_str().unwrap()];
    refused(&rig(&args), 1);
    assert_eq!(fs::read_to_string(&existing).unwrap(), "precious");
}

#[test]
fn the_csv_file_stays_when_nothing_can_be_written_beside_a_plot() {
    let folder = folder("part-blocked");
    let (existing, plot) = (folder.join("keep.csv"), folder.join("x.svg"));
    fs::write(&plot, "the plot before").unwrap();
    // A folder at the place of the temporary file, which is named by the process.
    let script = "mkdir \"$1/.x.svg.$$.part\" && exec \"$2\" rig --fast --standby --csv \"$1/keep.csv\" $3 \"$1/x.svg\"";
    fs::write(&existing, "precious").unwrap();
    let output = Command::new("sh")
        .args(["-c", script, "sh", folder.to_str().unwrap(), env!("CARGO_BIN_EXE_jetlink"), "--plot"])
        .output()
        .expect("it runs");
    assert!(refused(&output, 1).contains("x.svg: "));
    assert_eq!(fs::read_to_string(&existing).unwrap(), "precious");
    assert_eq!(fs::read_to_string(&plot).unwrap(), "the plot before");
}

/// The capture is made before the run, the others at its end: the report would be lost.
#[test]
fn an_option_cannot_name_the_folder_of_the_capture() {
    let folder = folder("is-capture");
    let name = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    for (report, capture) in [("r.html", "r.html"), ("r.html", "r.html/below"), ("./r.html", "r.html/a/b")] {
        let (report, capture) = (name(report), name(capture));
        let args = ["--fast", "--standby", "--report", &report, "--capture", &capture];
        let error = refused(&rig(&args), 2);
        assert!(error.contains("--capture would need a folder where --report writes a file"), "{error}");
        assert!(!fs::exists(name("r.html")).unwrap());
    }
    // A name that only begins in the same way is another one.
    let args = ["--fast", "--standby", "--report", &name("r.html"), "--capture", &name("r.html2")];
    assert_eq!(rig(&args).status.code(), Some(0));
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn an_option_cannot_name_a_file_of_the_capture() {
    let folder = folder("in-capture");
    let capture = folder.join("cap");
    fs::create_dir(&capture).unwrap();
    for name in ["left-from-ecu.bin", "left-to-ecu.bin"] {
        let csv = capture.join(name);
        let args =
            ["--fast", "--standby", "--csv", csv.to_str().unwrap(), "--capture", capture.to_str().unwrap()];
        let error = refused(&rig(&args), 2);
        assert!(error.contains("--csv and --capture name the same file"), "{error}");
        assert!(!csv.exists());
    }
    // Another name in that folder is another file; and the folder may be new.
    let (csv, new) = (capture.join("run.csv"), folder.join("new"));
    for capture in [&capture, &new] {
        let args =
            ["--fast", "--standby", "--csv", csv.to_str().unwrap(), "--capture", capture.to_str().unwrap()];
        assert_eq!(rig(&args).status.code(), Some(0));
        assert!(capture.join("left-to-ecu.bin").exists() && csv.exists());
    }
}

/// Its target does not exist, so the intended file is unknown.
#[test]
#[cfg(unix)]
fn a_link_that_leads_nowhere_is_refused_by_name() {
    let folder = folder("dangling");
    for (option, name) in [("--csv", "a.csv"), ("--plot", "a.svg"), ("--report", "a.html")] {
        let link = folder.join(name);
        std::os::unix::fs::symlink("not-there", &link).unwrap();
        let error = refused(&rig(&["--fast", "--standby", option, link.to_str().unwrap()]), 1);
        let expected =
            format!("cannot write {}: it is a link to not-there, which does not exist", link.display());
        assert!(error.contains(&expected), "{error}");
        assert!(link.is_symlink() && !folder.join("not-there").exists());
        // A link to a file is followed.
        fs::write(folder.join("not-there"), "").unwrap();
        assert_eq!(rig(&["--fast", "--standby", option, link.to_str().unwrap()]).status.code(), Some(0));
        assert!(link.is_symlink() && !fs::read(folder.join("not-there")).unwrap().is_empty());
        fs::remove_file(folder.join("not-there")).unwrap();
    }
}

#[test]
fn the_command_that_plays_a_run_again_is_quoted_for_a_shell() {
    let folder = folder("a folder with spaces");
    let script = folder.join("it's.txt");
    let output = rig(&["--fast", "--standby", "--save-script", script.to_str().unwrap()]);
    let printed = text(&output.stdout);
    let line = printed
        .lines()
        .find_map(|line| line.strip_prefix("To play it again: cargo rig "))
        .expect("a command");
    let words = Command::new("sh").args(["-c", &format!("printf '%s\\n' {line}")]).output().expect("a shell");
    assert_eq!(text(&words.stdout), format!("--script\n{}\n--fast\n", script.display()));
}

/// A played run is not lost with its file.
#[test]
fn a_script_that_cannot_be_saved_is_printed() {
    let script = folder("unsaved").join("run.txt");
    let text_of = |end: &str| {
        let engines = "seed 1\nengine name=left,ecu=zk\nstandby\n";
        format!(
            "jetlink rig script, version {}\n{engines}1.0 left disarm\n{end} end\n",
            env!("CARGO_PKG_VERSION")
        )
    };
    fs::write(&script, text_of("3.0")).unwrap();
    let output = rig(&["--fast", "--script", script.to_str().unwrap(), "--save-script", "/dev/full"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("cannot write /dev/full"), "{}", text(&output.stderr));
    let printed = text(&output.stdout);
    assert!(printed.ends_with(&format!("\nThe script file of this run:\n{}", text_of("3.0"))), "{printed}");
}

#[test]
fn two_options_cannot_name_one_file() {
    let folder = folder("one-file");
    let (file, other) = (folder.join("a.svg"), folder.join("./b/../a.svg"));
    fs::create_dir(folder.join("b")).unwrap();
    for exists in [false, true] {
        if exists {
            fs::write(&file, "precious").unwrap();
        }
        for other in [&file, &other] {
            let output = rig(&["--fast", "--csv", file.to_str().unwrap(), "--plot", other.to_str().unwrap()]);
            assert!(refused(&output, 2).contains("--csv and --plot name the same file"));
        }
    }
    assert_eq!(fs::read_to_string(&file).unwrap(), "precious");
}

#[test]
fn no_output_replaces_the_script_that_is_played() {
    let script = folder("script-kept").join("run.txt");
    let text = "jetlink rig script, version 0.1.0\nstandby\n1.0 all disarm\n5.0 end\n";
    let link = script.with_file_name("link.csv");
    std::os::unix::fs::symlink(&script, &link).unwrap();
    for (option, path) in [("--csv", &script), ("--csv", &link), ("--save-script", &script)] {
        fs::write(&script, text).unwrap();
        let args = ["--fast", "--script", script.to_str().unwrap(), option, path.to_str().unwrap()];
        let error = refused(&rig(&args), 2);
        assert!(error.contains(&format!("--script and {option} name the same file")), "{error}");
        assert_eq!(fs::read_to_string(&script).unwrap(), text);
    }
    let other = script.with_file_name("other.csv");
    let args = ["--fast", "--script", script.to_str().unwrap(), "--csv", other.to_str().unwrap()];
    assert_eq!(rig(&args).status.code(), Some(0));
}

#[test]
fn an_output_has_a_name() {
    for option in ["--csv", "--plot", "--report", "--save-script", "--capture"] {
        let error = refused(&rig(&["--fast", "--standby", option, ""]), 2);
        assert!(error.contains(&format!("{option} needs the name of a ")), "{error}");
    }
}

#[test]
fn a_dash_is_not_a_file() {
    for option in ["--csv", "--plot", "--report", "--save-script"] {
        let error = refused(&rig(&["--fast", option, "-"]), 2);
        assert!(error.contains(&format!("{option} takes no \"-\": name /dev/stdout, or ./-")), "{error}");
    }
}

#[test]
fn two_names_of_one_file_are_one_file() {
    let folder = folder("hard-link");
    let (file, other) = (folder.join("a.csv"), folder.join("b.svg"));
    fs::write(&file, "precious").unwrap();
    fs::hard_link(&file, &other).unwrap();
    let args = ["--fast", "--csv", file.to_str().unwrap(), "--plot", other.to_str().unwrap()];
    assert!(refused(&rig(&args), 2).contains("--csv and --plot name the same file"));
    assert_eq!(fs::read_to_string(&file).unwrap(), "precious");
}

#[test]
fn an_svg_file_has_no_other_ending() {
    let file = folder("ending").join("x.png");
    let output = rig(&["--fast", "--plot", file.to_str().unwrap()]);
    assert!(refused(&output, 2).contains("--plot writes SVG: name the file "));
    assert!(!file.exists());
}

#[test]
fn the_csv_file_can_be_followed_and_a_kill_loses_a_second() {
    let folder = folder("followed");
    let (csv, plot) = (folder.join("f.csv"), folder.join("f.svg"));
    fs::write(&plot, "the plot before").unwrap();
    let args = ["--standby", "--duration", "60s", "--csv", csv.to_str().unwrap()];
    let mut child = Running(
        command(&[&args[..], &["--plot", plot.to_str().unwrap()]].concat())
            .stdout(Stdio::null())
            .spawn()
            .expect("it runs"),
    );
    // Whole buffers of 8 KiB would come every 2.5 s. A busy computer may show several steps as one, but not always.
    let size = || fs::metadata(&csv).map_or(0, |file| file.len());
    let mut seen = 0;
    wait::wait_until("a step that is smaller than a buffer", PATIENCE, || {
        assert!(child.0.try_wait().expect("a child").is_none(), "it has ended");
        let (before, now) = (seen, size());
        seen = now;
        before > 0 && now > before && now - before < 8000
    });
    child.0.kill().expect("SIGKILL");
    child.0.wait().expect("it ends");
    assert_eq!(
        fs::read_to_string(&plot).unwrap(),
        "the plot before",
        "it is replaced as a whole, at the end"
    );
}

/// A FIFO that nobody reads: before the run as a CSV file, after it as a plot or a report.
#[test]
fn a_signal_ends_the_wait_for_the_reader_of_a_fifo() {
    // Not SIGINT: a shell has it ignored in what runs in the background, and so in a test that does.
    for (option, name, status) in [
        ("--csv", "rows", 143),
        ("--plot", "run.svg", 1),
        ("--report", "run.html", 1),
        ("--save-script", "run.txt", 1),
    ] {
        let fifo = folder(&format!("unread{option}")).join(name);
        assert!(Command::new("mkfifo").arg(&fifo).status().expect("mkfifo").success());
        let mut command = command(&["--fast", "--standby", option, fifo.to_str().unwrap()]);
        let rig = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("it runs");
        let mut rig = Running(rig);
        let mut errors = BufReader::new(rig.0.stderr.take().expect("piped")).lines();
        let mut line = || errors.next().expect("a line").expect("text");
        assert_eq!(line(), format!("jetlink rig: waiting for a reader of {}", fifo.display()));
        let sent = Command::new("kill").arg(rig.0.id().to_string()).status();
        assert!(sent.expect("kill").success());
        let ended = line();
        assert!(ended.ends_with("the run ended before a reader opened the pipe"), "{option}: {ended}");
        wait::wait_until("the end", PATIENCE, || rig.0.try_wait().expect("a status").is_some());
        let ended = rig.0.wait().expect("a status");
        assert_eq!(ended.code(), Some(status), "{option}");
    }
}

#[test]
fn the_csv_file_can_be_a_fifo() {
    let fifo = folder("fifo").join("rows");
    assert!(Command::new("mkfifo").arg(&fifo).status().expect("mkfifo").success());
    let reader = {
        let fifo = fifo.clone();
        thread::spawn(move || fs::read_to_string(fifo).expect("rows"))
    };
    let output = rig(&["--fast", "--standby", "--csv", fifo.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let rows = reader.join().expect("a reader");
    assert!(rows.starts_with("t_s,engine,") && rows.lines().count() > 400, "{rows}");
    assert!(fs::metadata(&fifo).unwrap().len() == 0 && !fs::metadata(&fifo).unwrap().is_file());
}

#[test]
fn the_csv_file_can_be_the_standard_output() {
    let output = rig(&["--fast", "--standby", "--csv", "/dev/stdout"]);
    let (rows, printed) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(0), "{printed}");
    let columns = rows.lines().next().expect("a head").split(',').count();
    assert!(
        rows.lines().count() > 400 && rows.lines().all(|row| row.split(',').count() == columns),
        "{rows}"
    );
    assert!(printed.contains("Summary after"), "{printed}");
}

#[test]
fn rows_to_the_standard_output_follow_what_is_there() {
    let folder = folder("appended");
    let all = folder.join("all.csv");
    for path in ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"] {
        fs::write(&all, "precious\n").unwrap();
        let append = fs::OpenOptions::new().append(true).open(&all).unwrap();
        let output =
            command(&["--fast", "--standby", "--csv", path]).stdout(append).output().expect("it runs");
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let written = fs::read_to_string(&all).unwrap();
        assert!(
            written.starts_with("precious\nt_s,engine,"),
            "{path}: {}",
            &written[..80.min(written.len())]
        );
        assert!(written.lines().count() > 400 && written.ends_with('\n'));
    }
    // So do those to the standard error, with the text of the run before them.
    fs::write(&all, "precious\n").unwrap();
    let append = fs::OpenOptions::new().append(true).open(&all).unwrap();
    let status = command(&["--fast", "--standby", "--csv", "/dev/stderr"]).stderr(append).status();
    assert!(status.expect("it runs").success());
    assert!(fs::read_to_string(&all).unwrap().starts_with("precious\n"));
}

/// The shell empties it, and rows and text would be written over each other.
#[test]
fn an_option_cannot_name_the_file_of_the_standard_output() {
    let same = folder("same-as-stdout").join("same.csv");
    let name = same.to_str().unwrap();
    for option in ["--csv", "--save-script"] {
        let to = fs::File::create(&same).unwrap();
        let output = command(&["--fast", "--standby", option, name]).stdout(to).output().expect("it runs");
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        let reason = format!("{option} and the standard output name the same file, {name}: use /dev/stdout");
        assert!(error.contains(&reason), "{error}");
    }
}

#[test]
fn a_plot_is_replaced_and_leaves_nothing_beside_it() {
    let folder = folder("replaced");
    let plot = folder.join("p.svg");
    fs::write(&plot, "the plot before").unwrap();
    let output = rig(&["--fast", "--standby", "--plot", plot.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(fs::read_to_string(&plot).unwrap().starts_with("<svg"));
    let left: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["p.svg"]);
}

#[test]
fn a_report_is_one_page_with_the_verdict_and_all_events() {
    let folder = folder("report");
    let page = folder.join("r.html");
    fs::write(&page, "the page before").unwrap();
    // One that cannot be written leaves it.
    refused(&rig(&["--fast", "--report", page.to_str().unwrap(), "--plot", "/nonexistent/x.svg"]), 1);
    assert_eq!(fs::read_to_string(&page).unwrap(), "the page before");
    let error = refused(&rig(&["--fast", "--report", folder.join("r.htm").to_str().unwrap()]), 2);
    assert!(error.contains("--report writes HTML: name the file "), "{error}");

    let args = ["--fast", "--faults", "no-light=left", "--report", page.to_str().unwrap()];
    let output = rig(&args);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let html = fs::read_to_string(&page).unwrap();
    let (_, data) = html.split_once("type=\"application/json\">").expect("data");
    let (data, _) = data.split_once("</script>").expect("its end");
    let run: serde_json::Value = serde_json::from_str(data).expect("JSON");
    let verdict = |engine: usize| run["engines"][engine]["verdict"]["text"].as_str().unwrap();
    assert_eq!((verdict(0), verdict(1)), ("FAILED", "PASS: reached its targets, and is shut down"));
    assert_eq!(run["verdict"]["failed"], true);
    // What the summary has of it, and each event as it was printed.
    let printed = text(&output.stdout);
    let problem = run["engines"][0]["verdict"]["problems"][0].as_str().unwrap();
    assert!(printed.contains(&format!("FAILED  left: {problem}")), "{problem}");
    let events = run["events"].as_array().unwrap();
    assert!(events.len() > 40, "{}", events.len());
    for event in events {
        assert!(printed.contains(event[2].as_str().unwrap()), "{event}");
    }
    // Nothing from elsewhere.
    for outside in ["http:", "https:", "src=", "href=", "@import", "url("] {
        assert!(!html.contains(outside), "{outside}");
    }
    let left: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["r.html"]);
}

#[test]
fn a_reader_that_has_had_enough_is_not_a_failure() {
    for args in [&["--fast", "--duration", "1h"][..], &["--list-scenarios"]] {
        let mut child =
            Running(command(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it runs"));
        let mut line = String::new();
        let mut reader = BufReader::with_capacity(16, child.0.stdout.take().expect("piped"));
        reader.read_line(&mut line).expect("a line");
        drop(reader);
        let mut errors = String::new();
        child.0.stderr.take().expect("piped").read_to_string(&mut errors).expect("UTF-8");
        let status = child.0.wait().expect("it ends");
        assert_eq!((errors.as_str(), status.code()), ("", Some(0)), "{args:?}");
    }
}

#[test]
fn a_reader_of_rows_that_has_had_enough_is_not_a_failure() {
    let args = ["--fast", "--duration", "1h", "--csv", "/dev/stdout"];
    // Messages go to standard error, which the test does not read.
    let mut child =
        Running(command(&args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it runs"));
    let errors = child.0.stderr.take().expect("piped");
    let printed =
        thread::spawn(move || BufReader::new(errors).lines().map_while(Result::ok).collect::<Vec<_>>());
    let mut line = String::new();
    let mut reader = BufReader::with_capacity(16, child.0.stdout.take().expect("piped"));
    reader.read_line(&mut line).expect("a line");
    drop(reader);
    let status = child.0.wait().expect("it ends");
    let printed = printed.join().expect("its lines");
    assert_eq!(status.code(), Some(0), "{printed:?}");
    assert!(
        line.starts_with("t_s,engine,") && !printed.iter().any(|line| line.contains("Broken pipe")),
        "{printed:?}"
    );
}

#[test]
fn the_csv_file_has_faults_and_events() {
    let csv = folder("events").join("e.csv");
    let args = ["--fast", "--faults", "flame-out=right@100s,cut=left@90s+1s", "--csv", csv.to_str().unwrap()];
    let output = rig(&args);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stdout));
    let rows = fs::read_to_string(&csv).unwrap();
    let of = |name: &'static str| rows.lines().filter(move |row| row.split(',').nth(1) == Some(name));
    let cell = |row: &str, from_end| row.rsplit(',').nth(from_end).unwrap().to_owned();
    assert!(of("right").any(|row| cell(row, 0).contains("the flame goes out")), "{rows}");
    assert!(of("right").any(|row| cell(row, 1).contains("rpm")), "no fault of right: {rows}");
    assert!(of("left").any(|row| cell(row, 0) == "the line is cut"));
    assert!(of("left").any(|row| cell(row, 0).starts_with("all: the node has started")));
    let columns = rows.lines().next().unwrap().split(',').count();
    assert!(rows.lines().all(|row| row.split(',').count() == columns));
}

#[test]
fn commands_while_the_node_listens_are_not_counted_as_rejected() {
    let csv = folder("rejected").join("r.csv");
    assert_eq!(rig(&["--fast", "--csv", csv.to_str().unwrap()]).status.code(), Some(0));
    let rows = fs::read_to_string(&csv).unwrap();
    let heads: Vec<&str> = rows.lines().next().unwrap().split(',').collect();
    let column = heads.iter().position(|head| *head == "rejected").unwrap();
    let bad: Vec<&str> = rows.lines().skip(1).filter(|row| row.split(',').nth(column) != Some("0")).collect();
    assert!(bad.is_empty(), "{}", bad.join("\n"));
    assert!(text(&rig(&["--help"]).stdout).contains("commands rejected "));
}

#[test]
fn the_summary_fits_80_columns() {
    let engine = |i: u32| format!("name=an-engine-{i:02},ecu=amt,baud=115200");
    for count in [4, 8] {
        let engines: Vec<String> = (1..=count).flat_map(|i| ["--engine".to_owned(), engine(i)]).collect();
        let args =
            [&["--fast", "--standby"][..], &engines.iter().map(String::as_str).collect::<Vec<_>>()].concat();
        let output = text(&rig(&args).stdout);
        let (_, summary) = output.split_once("\nSummary after").expect("a summary");
        let wide = summary.lines().find(|line| line.chars().count() > 80);
        assert_eq!(wide, None);
        for i in 1..=count {
            assert!(summary.contains(&format!("an-engine-{i:02}")), "{summary}");
        }
    }
    let scenarios = text(&rig(&["--list-scenarios"]).stdout);
    let names: Vec<&str> = scenarios.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert!(names.len() > 10, "{scenarios}");
    for name in names {
        let output = text(&rig(&["--fast", "--scenario", name]).stdout);
        let (_, summary) = output.split_once("\nSummary after").expect("a summary");
        assert!(summary.contains("\nExpected events"), "{summary}");
        let wide = summary.lines().find(|line| line.chars().count() > 80);
        assert_eq!(wide, None, "{name}");
    }
}

#[test]
fn a_fault_that_cannot_act_is_refused() {
    for (faults, part) in [
        ("flame-out=left@9999s", "its flame burns from about"),
        ("cut=left@40s+0s", "no length"),
        ("cut=left@9999s+1s", "after the end of the run"),
        ("noise=0.1,noise=0.2", "given twice"),
        ("hot-start=left,no-light=left", "contradict"),
        ("from=5s", "nothing would go wrong"),
        ("flame-out=left@40s,flame-out=left@45s", "its flame burns again from about"),
    ] {
        let error = refused(&rig(&["--fast", "--faults", faults]), 2);
        assert!(error.contains(part), "{faults}: {error}");
    }
}

/// The known results are printed even if something cannot be written at the end.
#[test]
fn the_summary_is_printed_when_a_file_cannot_be_completed() {
    let folder = folder("gone-at-the-end");
    let full = rig(&["--fast", "--standby", "--csv", "/dev/full"]);
    assert_eq!(full.status.code(), Some(1));
    assert!(text(&full.stdout).contains("Summary after"), "{}", text(&full.stdout));
    assert!(text(&full.stderr).ends_with("cannot write /dev/full: No space left on device (os error 28)\n"));
    // The folder of the others is gone when they are written: the run waits for the reader of the CSV file meanwhile.
    let (gone, csv) = (folder.join("gone"), folder.join("csv"));
    fs::create_dir(&gone).unwrap();
    assert!(Command::new("mkfifo").arg(&csv).status().expect("mkfifo").success());
    let (report, script) = (gone.join("x.html"), gone.join("x.txt"));
    let args = ["--fast", "--standby", "--csv", csv.to_str().unwrap()];
    let args =
        [&args[..], &["--report", report.to_str().unwrap(), "--save-script", script.to_str().unwrap()]]
            .concat();
    let child = command(&args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it runs");
    let mut child = Running(child);
    let mut errors = BufReader::new(child.0.stderr.take().expect("a pipe"));
    let (mut printed, mut error) = (String::new(), String::new());
    errors.read_line(&mut error).expect("a line");
    assert!(error.contains("waiting for a reader"), "{error}");
    fs::remove_dir_all(&gone).unwrap();
    let rows = fs::read_to_string(&csv).unwrap();
    child.0.stdout.take().expect("a pipe").read_to_string(&mut printed).expect("UTF-8");
    errors.read_to_string(&mut error).expect("UTF-8");
    assert_eq!(child.0.wait().expect("it ends").code(), Some(1), "{error}");
    assert!(rows.lines().count() > 100 && printed.contains("PASS: all engines reached"), "{printed}");
    assert!(error.contains("cannot write") && error.contains("x.html") && error.contains("x.txt"), "{error}");
}

/// A file that only one person may read stays so, and until the end there is no temporary file that a kill could leave.
#[test]
fn a_picture_keeps_the_permissions_of_the_one_before() {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder("mode-600");
    let plot = folder.join("x.svg");
    fs::write(&plot, "the plot before").unwrap();
    fs::set_permissions(&plot, fs::Permissions::from_mode(0o600)).unwrap();
    let csv = folder.join("csv");
    assert!(Command::new("mkfifo").arg(&csv).status().expect("mkfifo").success());
    let args = ["--fast", "--standby", "--plot", plot.to_str().unwrap(), "--csv", csv.to_str().unwrap()];
    let mut child =
        Running(command(&args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("it runs"));
    let mut line = String::new();
    BufReader::new(child.0.stderr.take().expect("a pipe")).read_line(&mut line).expect("a line");
    assert!(line.contains("waiting for a reader"), "{line}");
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 2, "the picture before and the FIFO");
    assert!(fs::read_to_string(&csv).unwrap().lines().count() > 100);
    assert_eq!(child.0.wait().expect("it ends").code(), Some(0));
    assert_eq!(fs::metadata(&plot).unwrap().permissions().mode() & 0o777, 0o600);
    assert!(fs::read_to_string(&plot).unwrap().starts_with("<svg"), "another picture");
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 2);
}
