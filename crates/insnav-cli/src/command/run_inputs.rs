//! Which logs become which outputs.

use crate::failure::Failure;
use insnav_log::is_standard_stream;
use std::path::{Path, PathBuf};

/// One log and where its solution goes; `-` is standard input or output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Job {
    pub(super) input: PathBuf,
    pub(super) output: PathBuf,
}

/// What a verb calls its outputs: `drive.mcap` becomes `drive.insnav.mcap` beside it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ending {
    /// Of `run`.
    Solution,
    /// Of `ahrs`.
    Orientation,
}

impl Ending {
    const ALL: [Self; 2] = [Self::Solution, Self::Orientation];

    fn name(self) -> &'static str {
        match self {
            Ending::Solution => "insnav.mcap",
            Ending::Orientation => "ahrs.mcap",
        }
    }

    /// Whether a file has the name of an output.
    pub(super) fn is_output(name: &str) -> bool {
        Self::ALL
            .iter()
            .any(|ending| name.ends_with(&format!(".{}", ending.name())))
    }
}

/// A job for every log; a folder stands for the logs in it.
pub(super) fn job_list(
    inputs: &[PathBuf],
    output: Option<&Path>,
    ending: Ending,
) -> Result<Vec<Job>, Failure> {
    let mut logs = Vec::new();
    for input in inputs {
        if input.is_dir() {
            logs.extend(logs_in(input)?);
        } else {
            logs.push(input.clone());
        }
    }
    let several = logs.len() > 1 || inputs.iter().any(|i| i.is_dir());
    let jobs: Vec<Job> = logs
        .into_iter()
        .map(|input| {
            let output = output_of(&input, output, several, ending)?;
            Ok(Job { input, output })
        })
        .collect::<Result<_, Failure>>()?;
    for (i, job) in jobs.iter().enumerate() {
        if let Some(other) = jobs[..i].iter().find(|other| other.output == job.output) {
            return Err(Failure::usage(
                format!(
                    "{} and {} would both be written to {}",
                    other.input.display(),
                    job.input.display(),
                    job.output.display()
                ),
                "run them one by one, each with an output of its own by `-o`",
            ));
        }
    }
    Ok(jobs)
}

fn output_of(
    log: &Path,
    output: Option<&Path>,
    several: bool,
    ending: Ending,
) -> Result<PathBuf, Failure> {
    let default = log.with_extension(ending.name());
    match output {
        None if is_standard_stream(log) => Err(Failure::usage(
            "standard input has no name to derive the output's from",
            "name it with -o",
        )),
        None => Ok(default),
        Some(to) if is_standard_stream(to) && several => Err(Failure::usage(
            "several solutions cannot share standard output",
            "name a folder with -o, or run the logs one by one",
        )),
        Some(to) if to.is_dir() && is_standard_stream(log) => Err(Failure::usage(
            format!(
                "{}: standard input has no name to derive the output's from",
                to.display()
            ),
            "name a file with -o",
        )),
        Some(to) if to.is_dir() => Ok(to.join(default.file_name().unwrap_or_default())),
        Some(to) if several => Err(Failure::usage(
            format!("{}: several logs need a folder that exists", to.display()),
            "make the folder, or run the logs one by one",
        )),
        Some(to) => Ok(to.to_path_buf()),
    }
}

/// No output takes the place of what it is made of.
pub(super) fn not_the_input(input: &Path, output: &Path) -> Result<(), Failure> {
    match (input.canonicalize(), output.canonicalize()) {
        (Ok(a), Ok(b)) if a == b => Err(Failure::new(
            "output_is_input",
            format!(
                "{}: the output would take the place of the input",
                output.display()
            ),
            "name another output with `-o`",
        )),
        _ => Ok(()),
    }
}

/// The MCAP files of a folder by name, without solutions.
fn logs_in(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let entries = std::fs::read_dir(folder).map_err(|e| {
        Failure::new(
            "not_readable",
            format!("{}: cannot be read: {e}", folder.display()),
            "check the permissions",
        )
    })?;
    let is_log = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        path.is_file()
            && !name.starts_with('.')
            && name.ends_with(".mcap")
            && !Ending::is_output(&name)
    };
    let mut logs: Vec<PathBuf> = entries
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(is_log)
        .collect();
    logs.sort();
    if logs.is_empty() {
        return Err(Failure::new(
            "no_logs",
            format!("{}: no MCAP log in this folder", folder.display()),
            "give the path of a log, or of a folder with files *.mcap",
        ));
    }
    if logs.len() > 1 && folder.join("metadata.yaml").is_file() {
        // Each run alone would start anew in the middle of the drive.
        let parts: Vec<String> = logs.iter().map(|p| p.display().to_string()).collect();
        return Err(Failure::new(
            "split_recording",
            format!(
                "{}: one recording in {} parts (it has a metadata.yaml): {}",
                folder.display(),
                parts.len(),
                parts.join(", ")
            ),
            "run the parts in order, the first with `--save-state run.state`, each other with `--resume run.state --save-state run.state`, \
             the last with `--resume run.state` alone; or merge them with `ros2 bag convert`",
        ));
    }
    Ok(logs)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jobs(inputs: &[&str], output: Option<&str>) -> Result<Vec<Job>, Failure> {
        let inputs: Vec<PathBuf> = inputs.iter().map(PathBuf::from).collect();
        job_list(&inputs, output.map(Path::new), Ending::Solution)
    }

    #[test]
    fn the_solution_stands_beside_its_log() {
        let [job] = &jobs(&["/data/drive.mcap"], None).unwrap()[..] else {
            panic!("one job");
        };
        assert_eq!(job.output, Path::new("/data/drive.insnav.mcap"));
    }

    #[test]
    fn no_two_logs_share_an_output() {
        let folder = tempfile::tempdir().unwrap();
        let to = folder.path().to_str();
        assert!(jobs(&["a/drive.mcap", "b/drive.mcap"], None).is_ok());
        let refused = jobs(&["a/drive.mcap", "b/drive.mcap"], to).unwrap_err();
        assert_eq!(refused.exit, crate::failure::USAGE);
        assert!(
            refused.message.contains("a/drive.mcap") && refused.message.contains("b/drive.mcap")
        );
        assert!(jobs(&["a/drive.mcap", "a/drive.mcap"], None).is_err());
        assert!(jobs(&["a.mcap", "b.mcap"], Some("-")).is_err());
        assert!(jobs(&["a.mcap", "b.mcap"], Some("no/such/folder")).is_err());
    }

    #[test]
    fn a_folder_is_the_logs_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        assert_eq!(
            jobs(&[folder.path().to_str().unwrap()], None)
                .unwrap_err()
                .code,
            "no_logs"
        );
        for name in [
            "b.mcap",
            "a.mcap",
            "a.insnav.mcap",
            "a.ahrs.mcap",
            "notes.txt",
        ] {
            std::fs::write(at(name), "").unwrap();
        }
        let found = jobs(&[folder.path().to_str().unwrap()], None).unwrap();
        let inputs: Vec<&PathBuf> = found.iter().map(|job| &job.input).collect();
        assert_eq!(inputs, [&at("a.mcap"), &at("b.mcap")]);
        std::fs::write(at("metadata.yaml"), "").unwrap();
        let refused = jobs(&[folder.path().to_str().unwrap()], None).unwrap_err();
        assert_eq!(refused.code, "split_recording");
    }
}
