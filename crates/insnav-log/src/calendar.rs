//! Dates and the two times that receivers give: UTC and GPS time.

use insnav_core::time::Time;

const DAY_NS: i64 = 86_400_000_000_000;
/// 1980-01-06, the zero of GPS time, in days of Unix time.
const GPS_EPOCH_DAY: i64 = 3657;

/// Days from which GPS time is one second more ahead of UTC than before, by year and month, the first day of it
/// ([IERS-C], the leap seconds since 1980). No further one is announced.
const LEAP_SECONDS: [(i64, u32); 18] = [
    (1981, 7),
    (1982, 7),
    (1983, 7),
    (1985, 7),
    (1988, 1),
    (1990, 1),
    (1991, 1),
    (1992, 7),
    (1993, 7),
    (1994, 7),
    (1996, 1),
    (1997, 7),
    (1999, 1),
    (2006, 1),
    (2009, 1),
    (2012, 7),
    (2015, 7),
    (2017, 1),
];

/// Days since 1970-01-01 of a date of the Gregorian calendar; `None` for one that does not exist.
pub(crate) fn day_of(year: i64, month: u32, day: u32) -> Option<i64> {
    let days = days_from(year, month, day)?;
    (date_of(days) == (year, month, day)).then_some(days)
}

fn days_from(year: i64, month: u32, day: u32) -> Option<i64> {
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) || !(1..=9999).contains(&year) {
        return None;
    }
    // Years that begin in March have their leap day at the end, and months of 30.6 days on average.
    let (y, m) = match month {
        1 | 2 => (year - 1, i64::from(month) + 9),
        _ => (year, i64::from(month) - 3),
    };
    let of_year = (153 * m + 2) / 5 + i64::from(day) - 1;
    let leap_days = y / 4 - y / 100 + y / 400;
    Some(365 * y + leap_days + of_year - 719_468)
}

/// Year, month and day.
fn date_of(days: i64) -> (i64, u32, u32) {
    let since_march_0 = days + 719_468;
    let era = since_march_0.div_euclid(146_097);
    let of_era = since_march_0.rem_euclid(146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let m = (5 * of_year + 2) / 153;
    let day = of_year - (153 * m + 2) / 5 + 1;
    let month = if m < 10 { m + 3 } else { m - 9 };
    let year = 400 * era + year_of_era + i64::from(month <= 2);
    (year, month as u32, day as u32)
}

/// The instant of a day and the nanoseconds into it.
pub(crate) fn at(day: i64, ns_of_day: i64) -> Option<Time> {
    day.checked_mul(DAY_NS)?.checked_add(ns_of_day).map(Time)
}

/// Day since 1970 and nanoseconds into it.
pub(crate) fn split(time: Time) -> (i64, i64) {
    (time.0.div_euclid(DAY_NS), time.0.rem_euclid(DAY_NS))
}

/// UTC of an instant whose clock shows GPS time: leap seconds are taken off.
pub(crate) fn utc_from_gps_time(shown: Time) -> Time {
    let leap = |time: Time| {
        let (day, _) = split(time);
        LEAP_SECONDS
            .iter()
            .filter(|(year, month)| days_from(*year, *month, 1).is_some_and(|first| first <= day))
            .count() as i64
    };
    // The leap second itself counts by UTC.
    let first_guess = Time(shown.0 - leap(shown) * 1_000_000_000);
    Time(shown.0 - leap(first_guess) * 1_000_000_000)
}

/// What a GPS clock shows as a date at this week and time of week.
pub(crate) fn gps_time(week: i64, ns_of_week: i64) -> Option<Time> {
    let day = week.checked_mul(7)?.checked_add(GPS_EPOCH_DAY)?;
    at(day, ns_of_week)
}

/// Seconds with a decimal fraction as nanoseconds, exact to the nanosecond.
pub(crate) fn parse_ns(text: &str) -> Option<i64> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    if whole.is_empty() || !digits(whole) || !digits(fraction) {
        return None;
    }
    let mut ns: i64 = 0;
    for i in 0..9 {
        let digit = fraction.as_bytes().get(i).map_or(0, |d| d - b'0');
        ns = 10 * ns + i64::from(digit);
    }
    whole
        .parse::<i64>()
        .ok()?
        .checked_mul(1_000_000_000)?
        .checked_add(ns)
}

/// UTC as RFC 3339 with milliseconds, such as `2020-09-13T12:26:40.000Z`.
pub(crate) fn rfc3339(time: Time) -> String {
    let (day, ns) = split(time);
    let (year, month, day) = date_of(day);
    let ms = ns / 1_000_000;
    let (s, ms) = (ms / 1000, ms % 1000);
    format!(
        "{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}.{ms:03}Z",
        s / 3600,
        s / 60 % 60,
        s % 60
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_and_dates() {
        assert_eq!(day_of(1970, 1, 1), Some(0));
        assert_eq!(day_of(1980, 1, 6), Some(GPS_EPOCH_DAY));
        assert_eq!(day_of(2000, 3, 1), Some(11_017));
        assert_eq!(day_of(2023, 2, 29), None);
        assert_eq!(day_of(2024, 13, 1), None);
        for day in -200_000..200_000 {
            let (y, m, d) = date_of(day);
            assert_eq!(day_of(y, m, d), Some(day), "{y}-{m}-{d}");
        }
        assert_eq!(
            rfc3339(Time(1_600_000_000_123_456_789)),
            "2020-09-13T12:26:40.123Z"
        );
    }

    #[test]
    fn gps_time_is_ahead_by_the_leap_seconds() {
        // The example of RTKLIB's manual: GPS week 1525, 259200 s is 2009-04-01 00:00:00 GPST; 15 s then.
        let shown = gps_time(1525, 259_200_000_000_000).unwrap();
        assert_eq!(rfc3339(shown), "2009-04-01T00:00:00.000Z");
        assert_eq!(
            rfc3339(utc_from_gps_time(shown)),
            "2009-03-31T23:59:45.000Z"
        );
        // On both sides of the last leap second: GPS 2017-01-01 00:00:17 was 23:59:60, then came 17 + 1.
        let day = day_of(2017, 1, 1).unwrap();
        let utc = |s: i64| rfc3339(utc_from_gps_time(at(day, s * 1_000_000_000).unwrap()));
        assert_eq!(utc(16), "2016-12-31T23:59:59.000Z");
        assert_eq!(utc(18), "2017-01-01T00:00:00.000Z");
        assert_eq!(LEAP_SECONDS.len(), 18);
    }

    #[test]
    fn fractions_are_exact() {
        assert_eq!(parse_ns("259200.123456789"), Some(259_200_123_456_789));
        assert_eq!(parse_ns("0.1"), Some(100_000_000));
        assert_eq!(
            (parse_ns(""), parse_ns("1e3"), parse_ns("-1")),
            (None, None, None)
        );
    }
}
