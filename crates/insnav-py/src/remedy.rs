//! Remedies are written for the command line; here its flags become the keywords of Python.

/// Flags as remedies have them, and what does the same in Python. Longer ones first where one contains another.
const WORDS: &[(&str, &str)] = &[
    (
        "choose another name with `-o`, or overwrite with `--force`",
        "choose another `output`, or `overwrite=True`",
    ),
    ("`--imu-only` (`gnss.use = false`)", "`imu_only=True`"),
    ("`--imu-only`", "`imu_only=True`"),
    ("`--force`", "`overwrite=True`"),
    (", with `-o`", " by `output`"),
    ("with `-o`", "by `output`"),
    ("`--time-offset`, in seconds", "`time_offset_s`"),
    ("`--time-offset auto`", "`time_offset_s=\"auto\"`"),
    ("`--time log`", "`time_source=\"log\"`"),
    (
        "`--set gnss.velocity_lag_s=…`",
        "`{\"gnss\": {\"velocity_lag_s\": …}}` in `config`",
    ),
    ("in the config file or with `--set`", "in `config`"),
    ("`--withhold`", "`withhold`"),
    ("`--from` and `--to`", "`part_s`"),
    ("`--from`, `--to`", "`part_s`"),
    ("shorter `--window`", "shorter `window_s`"),
    ("`--latitude-deg`", "`latitude_deg`"),
    (
        "`--recover` keeps",
        "the command `insnav convert --recover` keeps",
    ),
    (
        "with `--recover`",
        "with the command `insnav convert --recover`",
    ),
    (
        "`--heading-deg` with `--heading-sigma-deg`",
        "`heading_deg` with `heading_sigma_deg`",
    ),
    (
        "`--heading-deg`",
        "`config={\"alignment\": {\"heading_deg\": …}}`",
    ),
    ("`--gyro-range none`", "`gyro_range_deg_per_s=None`"),
    (
        "`--noise FILE` with a [noise] block",
        "`config={\"noise\": {…}}`",
    ),
    (
        "`--noise datasheet --set imu.grade=…`",
        "`noise=\"datasheet\"`, `config={\"imu\": {\"grade\": …}}`",
    ),
    (
        "`--stationary zupt`",
        "`config={\"stationary\": {\"mode\": \"zupt\"}}`",
    ),
    (
        "`--stationary off`",
        "`config={\"stationary\": {\"mode\": \"off\"}}`",
    ),
    (
        "`--imu-mounting-deg pitch=180`",
        "`config={\"imu\": {\"mounting_rpy_deg\": [0, 180, 0]}}`",
    ),
    ("with `--stop`", "by `stops`"),
    ("`--stop 40:200`", "`stops=[(40, 200)]`"),
    ("check `--stop` and stationary.", "check `stationary.`"),
    (
        "(`--stop`, stationary.intervals_s)",
        "(`stationary.intervals_s`)",
    ),
    ("(`--stop`, ", "(`stationary.intervals_s`, "),
    (
        "`--set imu.grade=navigation`",
        "`config={\"imu\": {\"grade\": \"navigation\"}}`",
    ),
    ("`--imu-axes frd`", "`imu_axes=\"frd\"`"),
    (
        "--reference-clock, --remove-mounting",
        "`reference_clock`, `remove_mounting`",
    ),
];

/// What remedies say of logs, and what is to be done where arrays were given. Longer ones first where one contains another.
const OF_ARRAYS: &[(&str, &str)] = &[
    ("add `--time log`", "correct the stamps"),
    (
        "or take all times from the recorder with `--time log`",
        "or correct the stamps",
    ),
    (
        "; if its stamps are wrong, `--time log` takes the recorder's",
        ", and correct its stamps",
    ),
    ("; `--time log` takes the recorder's", ""),
    (
        "take the recorder's with `--time log`, or correct the stamps",
        "correct the stamps, so that all kinds of data are on one clock",
    ),
    (
        "cut the log there, or use the recorder's clock with `--time log`",
        "cut the arrays there, or correct the stamps",
    ),
    (
        "check with `insnav info` that the IMU topic has messages",
        "give rows of `imu` or `imu_increment`",
    ),
    (
        "check with `insnav info` what the receiver says about its fixes",
        "give rows of `gnss_position` with latitude, longitude and height",
    ),
    (
        "do without it: `--topic gnss-velocity=none`; or let the driver give east, north, up",
        "leave `gnss_velocity` out, or give its columns as north, east, down",
    ),
    (
        "do without it: `--topic gnss-velocity=none`; or let the driver give m/s",
        "leave `gnss_velocity` out, or give it in m/s",
    ),
    (
        ", which `insnav info` prints; check them (`--stop`, stationary.intervals_s)",
        " (`solution.t0_ns`); check `stationary.intervals_s`",
    ),
    (
        "check `--stop` and stationary.intervals_s, which count from the log's zero (t0), and the topic that declares standing",
        "check `stationary.intervals_s`, which counts from the zero of the data (`solution.t0_ns`), and the array `standstill`",
    ),
    (
        "(`--stop`, the topic of standing)",
        "(`stationary.intervals_s`, the array `standstill`)",
    ),
    (
        "look at the topic that declares it, or leave it out with `--topic standing=none`",
        "look at the array `standstill`, or leave it out",
    ),
    (
        "leave the topic out with `--topic standing=none`",
        "leave the array `speed` out",
    ),
    (
        "of the topic that gives it, or leave it out (`--topic heading=none`)",
        "of `heading`, or leave it out",
    ),
    (
        "leave the magnetometer out with `--topic magnetometer=none`",
        "leave `magnetic_field` out",
    ),
    (
        "check the clocks of the topics that give them with `insnav info`",
        "check the clocks of the arrays that give them",
    ),
    (", which `insnav info` prints", " (`solution.t0_ns`)"),
    (
        "lever arm and clocks with `insnav info`",
        "lever arm and clocks",
    ),
    (
        "clocks and lever arm with `insnav info`",
        "clocks and lever arm",
    ),
    ("latency and clock with `insnav info`", "latency and clock"),
];

/// A remedy for whoever gave arrays: they have no topics, and no recorder.
pub(crate) fn of_arrays(remedy: &str) -> String {
    OF_ARRAYS
        .iter()
        .fold(remedy.to_owned(), |text, (of_logs, instead)| {
            text.replace(of_logs, instead)
        })
}

/// A remedy with Python's words for the command's flags.
pub(crate) fn in_python(remedy: &str) -> String {
    let mut text = remedy.to_owned();
    for &(flag, word) in WORDS {
        if text.contains(flag) {
            text = text.replace(flag, word);
        }
    }
    let text = velocity_axes(units(text));
    assignments(
        assignments(text, "--topic ", "topics", |role, name| {
            format!("{{\"{role}\": \"{name}\"}}")
        }),
        "--set ",
        "config",
        |key, value| match key.split_once('.') {
            Some((section, key)) => {
                format!("{{\"{section}\": {{\"{key}\": {}}}}}", literal(value))
            }
            None => format!("{{\"{key}\": {}}}", literal(value)),
        },
    )
}

/// Units are the caller's in Python, and of a log the command's.
fn units(text: String) -> String {
    let opening = "`--imu-units=";
    let Some((before, rest)) = text.split_once(opening) else {
        return text;
    };
    let Some((given, after)) = rest.split_once('`') else {
        return text;
    };
    // Nothing is added in Python: it is given otherwise.
    let (before, verb) = match before.strip_suffix("add ") {
        Some(before) => (before, "give "),
        None => (before, ""),
    };
    format!(
        "{before}{verb}rad/s and m/s² in arrays (these look like {given}), of a log what the command `insnav convert --imu-units={given}` makes of it{after}"
    )
}

/// Axes of velocities are those of NED in Python, and of a log the command's.
fn velocity_axes(text: String) -> String {
    let opening = "add `--gnss-velocity-axes ";
    let Some((before, rest)) = text.split_once(opening) else {
        return text;
    };
    let Some((axes, after)) = rest.split_once('`') else {
        return text;
    };
    format!(
        "{before}use what the command `insnav convert --gnss-velocity-axes={axes}` makes of the log{after}"
    )
}

/// A value as Python writes it: words need quotes.
fn literal(value: &str) -> String {
    let plain = value.parse::<f64>().is_ok() || value.starts_with(['[', '…']);
    match value {
        "true" => "True".into(),
        "false" => "False".into(),
        _ if plain => value.into(),
        word => format!("\"{word}\""),
    }
}

/// Every `` `--flag key=value` `` as `` `keyword=…` ``.
fn assignments(
    text: String,
    flag: &str,
    keyword: &str,
    write: impl Fn(&str, &str) -> String,
) -> String {
    let opening = format!("`{flag}");
    let mut out = String::with_capacity(text.len());
    let mut rest = text.as_str();
    while let Some(at) = rest.find(&opening) {
        let (before, found) = rest.split_at(at);
        out.push_str(before);
        let inner = &found[opening.len()..];
        let pair = inner
            .split_once('`')
            .and_then(|(pair, after)| Some((pair.split_once('=')?, after)));
        let Some(((key, value), after)) = pair else {
            out.push_str(&opening);
            rest = inner;
            continue;
        };
        out.push('`');
        out.push_str(keyword);
        out.push('=');
        out.push_str(&write(key, value));
        out.push('`');
        rest = after;
    }
    out.push_str(rest);
    out
}
