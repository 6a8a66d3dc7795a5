//! Time and place of a still from its EXIF data.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use exif::{Exif, In, Rational, Reader, Tag, Value};
use omnilife_schemas::records::Capture;

/// Capture time of a still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CaptureTime {
    /// Seconds since 1970 by the camera's clock, in UTC if it wrote its offset, else in local time.
    pub(crate) seconds: f64,
    /// True if the offset from UTC is known.
    pub(crate) is_utc: bool,
}

/// Reads facts from EXIF data (a TIFF structure); unreadable ones are left out.
///
/// # Errors
/// When the data are not EXIF data; one line.
pub(crate) fn read(data: Vec<u8>) -> Result<(Capture, Option<CaptureTime>), String> {
    let exif = Reader::new()
        .read_raw(data)
        .map_err(|error| format!("its EXIF data cannot be read: {error}"))?;
    let time = time(&exif);
    let capture = Capture {
        time: time.as_ref().map(|(text, _)| text.clone()),
        latitude_degrees: angle(&exif, Tag::GPSLatitude, Tag::GPSLatitudeRef, b'S', 90.0),
        longitude_degrees: angle(&exif, Tag::GPSLongitude, Tag::GPSLongitudeRef, b'W', 180.0),
        altitude_metres: altitude(&exif),
        direction_degrees: number(&exif, Tag::GPSImgDirection)
            .filter(|degrees| (0.0..=360.0).contains(degrees)),
        pose_degrees: None,
    };
    Ok((capture, time.map(|(_, taken)| taken)))
}

fn value(exif: &Exif, tag: Tag) -> Option<&Value> {
    Some(&exif.get_field(tag, In::PRIMARY)?.value)
}

fn ascii(exif: &Exif, tag: Tag) -> Option<&[u8]> {
    match value(exif, tag)? {
        Value::Ascii(texts) => texts.first().map(Vec::as_slice),
        _ => None,
    }
}

fn rationals(exif: &Exif, tag: Tag) -> Option<&[Rational]> {
    match value(exif, tag)? {
        Value::Rational(numbers) => Some(numbers),
        _ => None,
    }
}

fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    let number = rationals(exif, tag)?.first()?.to_f64();
    number.is_finite().then_some(number)
}

/// Returns degrees from degrees, minutes and seconds, negative if the reference starts with `negative`.
fn angle(exif: &Exif, tag: Tag, reference: Tag, negative: u8, most: f64) -> Option<f64> {
    let [degrees, minutes, seconds] = rationals(exif, tag)? else {
        return None;
    };
    let degrees = degrees.to_f64() + minutes.to_f64() / 60.0 + seconds.to_f64() / 3600.0;
    let is_negative = ascii(exif, reference)?.first() == Some(&negative);
    (degrees.is_finite() && degrees.abs() <= most).then_some(match is_negative {
        true => -degrees,
        false => degrees,
    })
}

fn altitude(exif: &Exif) -> Option<f64> {
    const BELOW_SEA: u8 = 1;
    let metres = number(exif, Tag::GPSAltitude)?;
    let is_below = matches!(value(exif, Tag::GPSAltitudeRef), Some(Value::Byte(bytes)) if bytes.first() == Some(&BELOW_SEA));
    Some(if is_below { -metres } else { metres })
}

/// Returns the time as text and in seconds; `None` also for a clock that was never set.
#[expect(
    clippy::arithmetic_side_effects,
    reason = "numbers of a date are at most four digits"
)]
fn time(exif: &Exif) -> Option<(String, CaptureTime)> {
    let mut date = exif::DateTime::from_ascii(ascii(exif, Tag::DateTimeOriginal)?).ok()?;
    // An unreadable one is left out.
    if let Some(text) = ascii(exif, Tag::SubSecTimeOriginal) {
        drop(date.parse_subsec(text));
    }
    if let Some(text) = ascii(exif, Tag::OffsetTimeOriginal) {
        drop(date.parse_offset(text));
    }
    if date.year == 0 || !(1..=12).contains(&date.month) || !(1..=31).contains(&date.day) {
        return None;
    }
    let days = days_since_1970(
        i64::from(date.year),
        i64::from(date.month),
        i64::from(date.day),
    );
    let of_day = 3600 * i64::from(date.hour) + 60 * i64::from(date.minute) + i64::from(date.second);
    let offset_minutes = i64::from(date.offset.unwrap_or_default());
    let whole = 86_400 * days + of_day - 60 * offset_minutes;
    let fraction = f64::from(date.nanosecond.unwrap_or_default()) * 1e-9;
    let mut text = format!(
        "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}",
        date.year, date.month, date.day, date.hour, date.minute, date.second
    );
    if date.nanosecond.is_some() {
        text.push_str(format!("{fraction:.3}").trim_start_matches('0'));
    }
    if date.offset.is_some() {
        let sign = if offset_minutes < 0 { '-' } else { '+' };
        let minutes = offset_minutes.abs();
        text.push_str(&format!("{sign}{:02}:{:02}", minutes / 60, minutes % 60));
    }
    Some((
        text,
        CaptureTime {
            seconds: whole as f64 + fraction,
            is_utc: date.offset.is_some(),
        },
    ))
}

/// Returns days from 1970-01-01 to a date of the Gregorian calendar.
#[expect(
    clippy::arithmetic_side_effects,
    reason = "years are at most four digits"
)]
fn days_since_1970(year: i64, month: i64, day: i64) -> i64 {
    // Years that start in March have their leap day at their end.
    let (year, month) = if month > 2 {
        (year, month - 3)
    } else {
        (year - 1, month + 9)
    };
    let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    365 * year + leap_days + (153 * month + 2) / 5 + day - 1 - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        assert_eq!(days_since_1970(1970, 1, 1), 0);
        assert_eq!(days_since_1970(2000, 2, 29), 11_016);
        assert_eq!(days_since_1970(2000, 3, 1), 11_017);
        assert_eq!(days_since_1970(2026, 11, 25), 20_782);
    }

    #[test]
    fn what_is_no_exif_is_refused() {
        for data in [&b""[..], b"II*\0", b"MM\0*\xff\xff\xff\xff", b"no"] {
            assert!(read(data.to_vec()).is_err(), "{data:?}");
        }
    }
}
