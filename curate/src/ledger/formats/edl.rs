//! An edit decision list, CMX 3600: one event per shot with timecodes in whole frames, without
//! dropped numbers. A gradual transition is an event of type D, whose dissolve lies before the part
//! of the new shot that is its own.

use std::fmt::Write;

use omnilife_schemas::records::Boundary;

use super::{Format, Frames};

pub(super) const FORMAT: Format = Format {
    id: "edl",
    summary: "An edit decision list (CMX 3600).",
    recognises: |text| text.starts_with("TITLE:") || text.starts_with("FCM:"),
    read,
    write,
};

/// Returns frame numbers per second of timecode: the frame rate rounded, as editors count.
fn base(frames: &Frames<'_>) -> usize {
    (frames.frames_per_second().round() as usize).max(1)
}

/// Reads events: `NUMBER REEL TRACK TYPE [LENGTH] SOURCE-IN SOURCE-OUT RECORD-IN RECORD-OUT`.
fn read(text: &str, frames: &Frames<'_>) -> Result<Vec<Boundary>, String> {
    if text.contains("FCM: DROP FRAME") {
        return Err(
            "drop-frame timecode is not understood; export it as non-drop frame".to_owned(),
        );
    }
    let base = base(frames);
    let mut boundaries = Vec::new();
    let mut previous_out = None;
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [number, _, _, kind, rest @ ..] = &words[..] else {
            continue;
        };
        let [.., source_in, source_out, _, record_out] = rest else {
            continue;
        };
        if !number.bytes().all(|byte| byte.is_ascii_digit()) || !record_out.contains(':') {
            continue;
        }
        let source_in = frame_number(source_in, base)?;
        let source_out = frame_number(source_out, base)?;
        // Some editors write a dissolve as two lines, of which the first has no length.
        if source_in == source_out {
            continue;
        }
        if let Some(out) = previous_out {
            let length = match (*kind, rest.first().map(|word| word.parse::<usize>())) {
                ("D", Some(Ok(length))) => length,
                ("D", _) => return Err(format!("event {number}: no length of a dissolve")),
                _ => 0,
            };
            let last = usize::checked_sub(out, 1).ok_or("an event ends at frame 0")?;
            boundaries.push(frames.between(last, source_in.saturating_add(length))?);
        }
        previous_out = Some(source_out);
    }
    Ok(boundaries)
}

#[expect(
    clippy::arithmetic_side_effects,
    reason = "numbers of frames that are there"
)]
fn write(boundaries: &[Boundary], frames: &Frames<'_>) -> Result<String, String> {
    let base = base(frames);
    let mut text = format!("TITLE: {}\nFCM: NON-DROP FRAME\n\n", frames.video);
    let mut transition_begin = None;
    for (index, (first, last)) in frames.shots(boundaries)?.into_iter().enumerate() {
        let start = transition_begin.unwrap_or(first);
        let kind = match first - start {
            0 => "C   ".to_owned(),
            length => format!("D {length:03}"),
        };
        let (inside, outside) = (timecode(start, base), timecode(last + 1, base));
        writeln!(
            text,
            "{:03}  AX       V     {kind}    {inside} {outside} {inside} {outside}",
            index + 1
        )
        .map_err(|error| error.to_string())?;
        transition_begin = Some(last + 1);
    }
    Ok(text)
}

/// Formats `HH:MM:SS:FF`.
#[expect(clippy::arithmetic_side_effects, reason = "the base is 1 at least")]
fn timecode(frame: usize, base: usize) -> String {
    let seconds = frame / base;
    format!(
        "{:02}:{:02}:{:02}:{:02}",
        seconds / 3600,
        seconds / 60 % 60,
        seconds % 60,
        frame % base
    )
}

fn frame_number(timecode: &str, base: usize) -> Result<usize, String> {
    let parts: Result<Vec<usize>, _> = timecode.split(':').map(str::parse).collect();
    let number = match parts.as_deref() {
        Ok(&[hours, minutes, seconds, frame]) if frame < base => hours
            .checked_mul(60)
            .and_then(|whole| whole.checked_add(minutes)?.checked_mul(60))
            .and_then(|whole| whole.checked_add(seconds)?.checked_mul(base))
            .and_then(|whole| whole.checked_add(frame)),
        _ => None,
    };
    number.ok_or_else(|| format!("must be a timecode of {base} frames per second, got {timecode}"))
}
