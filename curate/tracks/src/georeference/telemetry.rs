//! Telemetry of drones in subtitles (`.SRT`): positions over the time of the video.
//!
//! Two forms of DJI are read. Current ones state `[latitude: 48.1] [longitude: 11.5] [rel_alt: 30.1 abs_alt: 550.2]`,
//! with or without spaces before the colon; some firmware spells `longtitude`. Older ones state
//! `GPS(longitude,latitude,number)`, where the third number is a height or a count of satellites, and the height apart
//! from it as `BAROMETER:30.1` or `H 30.1m`. Blocks before the first position of the receiver (0, 0 or `n/a`) are left
//! out.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::Path;

use omnilife_schemas::{
    records::GeoPoint,
    store::{self, StoreError},
};

/// Maximum size of a file, bytes: four hours at 60 frames per second.
const MOST_BYTES: u64 = 512 << 20;
/// Longest gap between two positions that is bridged, seconds.
const LONGEST_GAP_SECONDS: f64 = 2.0;

/// Positions over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Telemetry {
    /// Reference of the heights: `abs_alt`, `rel_alt`, `barometer` or `gps`.
    pub heights: &'static str,
    /// Times in seconds, rising, with positions; one at least.
    pub positions: Vec<(f64, GeoPoint)>,
}

impl Telemetry {
    /// Reads a file of subtitles.
    ///
    /// # Errors
    /// When it cannot be read or holds no valid telemetry.
    pub fn read(path: &Path) -> Result<Self, StoreError> {
        let bytes = store::read_limited(path, MOST_BYTES)?;
        Self::from_bytes(&bytes).map_err(|reason| StoreError::malformed(path, reason))
    }

    /// Reads the bytes of a file of subtitles.
    ///
    /// # Errors
    /// The fault: text that is not UTF-8, times that do not rise, positions that are not on the Earth, heights of
    /// different references, or no positions.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let text = std::str::from_utf8(bytes).map_err(|_| "is not UTF-8".to_owned())?;
        let mut heights = None;
        let mut positions: Vec<(f64, GeoPoint)> = Vec::new();
        for block in blocks(text)? {
            let of_block = |reason: String| format!("line {}: {reason}", block.line);
            let Some(found) = position(&block.text).map_err(of_block)? else {
                continue;
            };
            if *heights.get_or_insert(found.heights) != found.heights {
                return Err(of_block("has a height of another reference".to_owned()));
            }
            match positions.last() {
                Some((last, _)) if block.seconds < *last => {
                    return Err(of_block("begins before the block above".to_owned()));
                }
                Some((last, _)) if block.seconds <= *last => {}
                _ => positions.push((block.seconds, found.point)),
            }
        }
        match heights {
            Some(heights) => Ok(Self { heights, positions }),
            None => Err("has no positions of a drone: [latitude: ..] or GPS(..)".to_owned()),
        }
    }

    /// Returns the position at a time by linear interpolation; `None` outside of the recording and in gaps longer
    /// than 2 seconds.
    pub fn at(&self, seconds: f64) -> Option<GeoPoint> {
        let after = self.positions.partition_point(|(time, _)| *time <= seconds);
        let (begin, from) = self.positions.get(after.checked_sub(1)?)?;
        let Some((end, to)) = self.positions.get(after) else {
            // The last frame is shown for a moment after its time.
            return (seconds - begin < 0.1).then_some(*from);
        };
        if end - begin > LONGEST_GAP_SECONDS {
            return (seconds - begin < 0.1).then_some(*from);
        }
        let share = (seconds - begin) / (end - begin);
        let mixed = |from: f64, to: f64| from + share * (to - from);
        Some(GeoPoint {
            latitude_degrees: mixed(from.latitude_degrees, to.latitude_degrees),
            longitude_degrees: mixed(from.longitude_degrees, to.longitude_degrees),
            altitude_metres: mixed(from.altitude_metres, to.altitude_metres),
        })
    }
}

struct Block {
    /// Number of the line of its time, from 1 on.
    line: usize,
    seconds: f64,
    text: String,
}

/// Splits subtitles at the lines of their times.
fn blocks(text: &str) -> Result<Vec<Block>, String> {
    let mut blocks: Vec<Block> = Vec::new();
    for (number, line) in (1..).zip(text.trim_start_matches('\u{feff}').lines()) {
        if let Some((begin, _)) = line.split_once("-->") {
            let seconds = time(begin.trim())
                .ok_or_else(|| format!("line {number}: {:?} is not a time", begin.trim()))?;
            blocks.push(Block {
                line: number,
                seconds,
                text: String::new(),
            });
        } else if let Some(block) = blocks.last_mut() {
            block.text.push_str(line);
            block.text.push('\n');
        }
    }
    Ok(blocks)
}

/// Returns the seconds of `HH:MM:SS,mmm`.
fn time(text: &str) -> Option<f64> {
    let parts: Vec<&str> = text.split(':').collect();
    let [hours, minutes, seconds] = parts.as_slice() else {
        return None;
    };
    let hours: u32 = hours.parse().ok()?;
    let minutes: u32 = minutes.parse().ok()?;
    let seconds: f64 = seconds.replace(',', ".").parse().ok()?;
    let is_time = minutes < 60 && (0.0..60.0).contains(&seconds);
    is_time.then(|| f64::from(hours) * 3600.0 + f64::from(minutes) * 60.0 + seconds)
}

/// Position with the reference of its height.
struct Position {
    point: GeoPoint,
    heights: &'static str,
}

/// Returns the position that a block states; `None` where it states none, or before the receiver has one.
fn position(text: &str) -> Result<Option<Position>, String> {
    let latitude = stated(text, "latitude")?;
    let longitude = match stated(text, "longitude")? {
        Some(longitude) => Some(longitude),
        None => stated(text, "longtitude")?,
    };
    let (latitude, longitude, height) = match (latitude, longitude) {
        (Some(latitude), Some(longitude)) => (latitude, longitude, height_of_entries(text)?),
        (None, None) => match older(text)? {
            Some(position) => position,
            None => return Ok(None),
        },
        _ => return Err("states one of latitude and longitude alone".to_owned()),
    };
    if latitude == 0.0 && longitude == 0.0 {
        return Ok(None);
    }
    let is_on_earth = latitude.abs() <= 90.0 && longitude.abs() <= 180.0;
    let (heights, altitude) = height;
    if !is_on_earth || altitude.abs() > 1e5 {
        return Err(format!(
            "is at {latitude}, {longitude}, {altitude} m, which is not on the Earth"
        ));
    }
    Ok(Some(Position {
        point: GeoPoint {
            latitude_degrees: latitude,
            longitude_degrees: longitude,
            altitude_metres: altitude,
        },
        heights,
    }))
}

/// Height with the name of its reference.
type Height = (&'static str, f64);

fn height_of_entries(text: &str) -> Result<Height, String> {
    for name in ["abs_alt", "rel_alt"] {
        if let Some(height) = stated(text, name)? {
            return Ok((name, height));
        }
    }
    // Without the two: `[altitude: 30.1]`.
    let height = stated(text, "altitude")?;
    height
        .map(|height| ("gps", height))
        .ok_or_else(|| "states no height".to_owned())
}

/// Returns latitude, longitude and height of the older form.
fn older(text: &str) -> Result<Option<(f64, f64, Height)>, String> {
    let found = words_after(text, "GPS").find_map(|rest| rest.trim_start().strip_prefix('('));
    let Some((inside, _)) = found.and_then(|rest| rest.split_once(')')) else {
        return Ok(None);
    };
    if inside.contains("n/a") {
        return Ok(None);
    }
    let numbers: Option<Vec<f64>> = inside
        .split(',')
        .map(|word| {
            word.trim()
                .parse()
                .ok()
                .filter(|value: &f64| value.is_finite())
        })
        .collect();
    let numbers = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    let [longitude, latitude, third] =
        numbers.ok_or_else(|| format!("GPS({inside}) has no three numbers"))?;
    let barometer = words_after(text, "BAROMETER")
        .find_map(|rest| leading_number(rest.trim_start().strip_prefix(':')?));
    let barometer = barometer.or_else(|| {
        // `H 30.1m`, beside `H.S 5.2m/s`.
        words_after(text, "H").find_map(|rest| leading_number(rest.strip_prefix(' ')?))
    });
    let height = barometer.map_or(("gps", third), |height| ("barometer", height));
    Ok(Some((latitude, longitude, height)))
}

/// Returns the number of an entry `name: number`; `None` without the entry.
fn stated(text: &str, name: &str) -> Result<Option<f64>, String> {
    let mut entries = words_after(text, name);
    let Some(rest) = entries.find_map(|rest| rest.trim_start().strip_prefix(':')) else {
        return Ok(None);
    };
    match leading_number(rest) {
        Some(number) => Ok(Some(number)),
        None => Err(format!("{name} is not a number")),
    }
}

/// Returns the texts after each occurrence of a word that no letter, digit or underscore precedes.
fn words_after<'t>(text: &'t str, word: &'t str) -> impl Iterator<Item = &'t str> {
    text.match_indices(word).filter_map(move |(at, word)| {
        let before = text.get(..at)?.chars().next_back();
        let begins = before.is_none_or(|before| !before.is_alphanumeric() && before != '_');
        begins
            .then(|| text.get(at.saturating_add(word.len())..))
            .flatten()
    })
}

/// Returns the finite number that a text begins with.
fn leading_number(text: &str) -> Option<f64> {
    let text = text.trim_start();
    let is_of_number = |letter: char| letter.is_ascii_digit() || "+-.".contains(letter);
    let end = text.find(|letter| !is_of_number(letter));
    let number = text.get(..end.unwrap_or(text.len()))?;
    number.parse().ok().filter(|value: &f64| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CURRENT: &str = "1\n00:00:00,000 --> 00:00:00,033\n<font size=\"28\">FrameCnt: 1, DiffTime: 33ms\n\
        2026-05-01 10:00:00.000\n[iso: 100] [shutter: 1/500] [latitude: 48.137154] [longitude: 11.576124] \
        [rel_alt: 30.100 abs_alt: 549.300] [ct: 5200]</font>\n\n2\n00:00:01,000 --> 00:00:01,033\n\
        [latitude: 48.137254] [longitude: 11.576224] [rel_alt: 31.100 abs_alt: 550.300]\n";

    fn read(text: &str) -> Result<Telemetry, String> {
        Telemetry::from_bytes(text.as_bytes())
    }

    #[test]
    fn both_forms_give_positions_and_times() {
        let current = read(CURRENT).expect("telemetry");
        assert_eq!(current.heights, "abs_alt");
        assert_eq!(current.positions.len(), 2);
        let middle = current.at(0.5).expect("within");
        assert!((middle.latitude_degrees - 48.137_204).abs() < 1e-9);
        assert!((middle.longitude_degrees - 11.576_174).abs() < 1e-9);
        assert!((middle.altitude_metres - 549.8).abs() < 1e-9);
        assert_eq!(current.at(-0.1), None);
        assert_eq!(current.at(2.0), None);
        let misspelt = CURRENT
            .replace("latitude:", "latitude :")
            .replace("longitude:", "longtitude :");
        assert_eq!(read(&misspelt), Ok(current));
        let older = "1\n00:00:00,000 --> 00:00:01,000\nHOME(11.5,48.1) 2017.08.05 14:11:51\n\
            GPS(11.5761,48.1371,16) BAROMETER:30.5\n\n2\n00:00:01,000 --> 00:00:02,000\n\
            F/2.8, GPS (11.5762, 48.1372, 17), D 24.27m, H 31.50m, H.S 5.20m/s, V.S 0.10m/s\n";
        let older = read(older).expect("telemetry");
        assert_eq!(older.heights, "barometer");
        let heights = older
            .positions
            .iter()
            .map(|(_, point)| point.altitude_metres);
        assert_eq!(heights.collect::<Vec<_>>(), [30.5, 31.5]);
        assert_eq!(older.positions[0].1.latitude_degrees, 48.1371);
        assert_eq!(older.positions[1].1.longitude_degrees, 11.5762);
    }

    #[test]
    fn faults_are_told_and_missing_receivers_are_left_out() {
        let fault = |from: &str, to: &str| read(&CURRENT.replace(from, to)).expect_err("a fault");
        assert!(fault("latitude: 48.137254", "latitude: x").contains("latitude is not a number"));
        assert!(fault("latitude: 48.137254", "latitude: 98.1").contains("not on the Earth"));
        assert!(fault(" abs_alt: 550.300", "").contains("another reference"));
        assert!(fault("[longitude: 11.576224] ", "").contains("one of latitude"));
        assert!(fault("00:00:01,000 -->", "00:61:01,000 -->").contains("not a time"));
        let no_fix = CURRENT
            .replace("latitude: 48.137154", "latitude: 0.0")
            .replace("longitude: 11.576124", "longitude: 0.0");
        assert_eq!(read(&no_fix).expect("telemetry").positions.len(), 1);
        let words = read("1\n00:00:00,000 --> 00:00:01,000\nHello.\n").expect_err("no telemetry");
        assert!(words.contains("no positions"), "{words}");
    }
}
