//! Several logs in one command, and folders of them.

use crate::fixture::{Folder, drive, insnav, insnav_json, write_log};

fn with_logs(names: &[&str]) -> Folder {
    let folder = Folder::new();
    let short: Vec<_> = drive().samples.iter().copied().take(7000).collect();
    for name in names {
        write_log(&folder.path(name), &short);
    }
    folder
}

/// One that fails does not take the others along; with several at once the order is that of the arguments.
#[test]
fn a_failure_is_one_entry_among_the_others() {
    let folder = with_logs(&["a.mcap", "c.mcap", "d.mcap"]);
    std::fs::write(folder.path("b.mcap"), "Dear diary,").unwrap();
    std::fs::write(folder.path("d.insnav.mcap"), "precious").unwrap();
    let mut ends = Vec::new();
    for jobs in ["1", "3"] {
        let logs = ["a.mcap", "b.mcap", "absent.mcap", "c.mcap", "d.mcap"].map(|n| folder.text(n));
        let mut arguments: Vec<&str> = vec!["run", "--jobs", jobs];
        arguments.extend(logs.iter().map(String::as_str));
        let done = insnav_json(&arguments);
        assert_eq!(done.code, 1);
        let json = done.json();
        let runs = json["runs"].as_array().unwrap();
        assert_eq!(runs.len(), 5);
        for (run, log) in runs.iter().zip(&logs) {
            assert_eq!(run["input"], log.as_str());
        }
        let code = |i: usize| runs[i]["error"]["code"].as_str();
        assert_eq!(
            [code(1), code(2), code(4)],
            [
                Some("not_an_mcap"),
                Some("no_such_file"),
                Some("output_exists")
            ]
        );
        assert!(runs[1]["error"]["remedy"].is_string() && runs[1]["error"]["message"].is_string());
        assert!(runs[0]["error"].is_null() && runs[3]["error"].is_null());
        ends.push((runs[0]["final"].clone(), runs[3]["final"].clone()));
        // Whatever is wrong, the file is named.
        let errors = done.stderr.lines().filter(|l| l.starts_with("error: "));
        assert!(
            errors.clone().count() == 3 && errors.clone().all(|l| l.contains(".mcap: ")),
            "{}",
            done.stderr
        );
        assert!(
            done.stderr.contains("absent.mcap: no such file"),
            "{}",
            done.stderr
        );
        for name in ["a.insnav.mcap", "c.insnav.mcap"] {
            std::fs::remove_file(folder.path(name)).unwrap();
        }
    }
    assert!(ends[0].0.is_object() && ends[0].0 == ends[0].1 && ends[0] == ends[1]);
    assert_eq!(
        std::fs::read(folder.path("d.insnav.mcap")).unwrap(),
        b"precious"
    );
}

#[test]
fn a_folder_is_its_logs_and_may_take_the_solutions() {
    let folder = with_logs(&["a.mcap", "b.mcap"]);
    std::fs::create_dir(folder.path("out")).unwrap();
    let (from, to) = (folder.text(""), folder.text("out"));
    let done = insnav_json(["run", from.as_str(), "-o", to.as_str()]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert_eq!(done.json()["runs"].as_array().unwrap().len(), 2);
    for name in ["out/a.insnav.mcap", "out/b.insnav.mcap"] {
        assert!(folder.path(name).is_file(), "{name}");
    }
    insnav_json(["run", to.as_str()]).failed(1, "no_logs");
}

#[test]
fn two_logs_of_one_name_do_not_overwrite_each_other() {
    let folder = with_logs(&["a.mcap"]);
    for part in ["x", "y"] {
        std::fs::create_dir(folder.path(part)).unwrap();
        std::fs::copy(folder.path("a.mcap"), folder.path(part).join("a.mcap")).unwrap();
    }
    let (x, y, to) = (
        folder.text("x/a.mcap"),
        folder.text("y/a.mcap"),
        folder.text(""),
    );
    let (message, _) = insnav_json(["run", &x, &y, "-o", &to, "--force"]).failed(2, "usage");
    assert!(message.contains(&x) && message.contains(&y), "{message}");
    assert_eq!(
        insnav(["run", x.as_str(), y.as_str()]).code,
        0,
        "beside their logs they have room"
    );
}
