//! Random videos through every command that opens one: no crash, no hang, one line. Container, codec, pixel format,
//! size, frame rate, time stamps, colours, rotation, sound and damaged bytes are drawn at random.
//!
//! An ordinary test run makes a few, always the same ones; `scripts/reliability media NUMBER` makes the given number.

use std::{fs, path::Path, process::Command};

use crate::{
    chance::Chance,
    outcomes::ending_fault,
    support::{Ended, scratch},
    trial::{omnilife_through, variable},
};

/// Default number of videos.
const VIDEOS: usize = 6;

const CONTAINERS: &[&str] = &["mp4", "mov", "mkv", "avi", "ts", "webm", "nut"];
/// Codecs, each with a pixel format that it supports.
const CODECS: &[[&str; 2]] = &[
    ["mpeg4", "yuv420p"],
    ["mjpeg", "yuvj422p"],
    ["ffv1", "gray"],
    ["ffv1", "yuv444p10le"],
    ["ffv1", "bgra"],
    ["png", "rgb24"],
    ["png", "pal8"],
    ["rawvideo", "yuv420p"],
    ["rawvideo", "gray16le"],
    ["rawvideo", "yuv410p"],
    ["libx264", "yuv420p"],
    ["libx264", "yuv422p10le"],
    ["libvpx-vp9", "yuv420p"],
    ["huffyuv", "yuv422p"],
    ["qtrle", "rgb555be"],
];
const SIZES: &[&str] = &[
    "64x32", "2x2", "1x1", "66x34", "4096x2", "2x1024", "16x8", "640x320",
];
const RATES: &[&str] = &["10", "1", "0.01", "1000", "30000/1001", "90000"];
/// Changes to time stamps.
const TIMES: &[&str] = &[
    "PTS",
    "PTS-STARTPTS-5/TB",
    "PTS+if(gte(N,3),3e9/TB,0)",
    "PTS*0",
    "if(mod(N,2),PTS,PTS+2/TB)",
    "N*N*N/TB",
    "PTS+1e12",
];
const OPTIONS: &[&str] = &[
    "-color_trc smpte2084 -color_primaries bt2020 -colorspace bt2020nc",
    "-color_trc log316 -color_primaries film -colorspace ycgco",
    "-color_range pc",
    "-aspect 1000:1",
    "-metadata:s:v rotate=90",
    "-metadata title=\u{1b}[31mred",
    "-movflags faststart",
    "-g 1",
    "-bf 2",
    "-field_order tb",
];

/// Makes a video; `None` where FFmpeg does not support the draw.
fn make(folder: &Path, number: usize, chance: &mut Chance) -> Option<(String, String)> {
    let container = chance.pick(CONTAINERS);
    let [codec, format] = chance.pick(CODECS);
    let (size, rate, times) = (chance.pick(SIZES), chance.pick(RATES), chance.pick(TIMES));
    let mut options: Vec<&str> = chance.pick(OPTIONS).split(' ').collect();
    options.extend(chance.pick(OPTIONS).split(' '));
    let file = folder.join(format!("{number:04}.{container}"));
    let sound: &[&str] = if chance.share() < 0.3 {
        &["-f", "lavfi", "-i", "sine=duration=1", "-shortest"]
    } else {
        &[]
    };
    let made = Command::new("timeout")
        .args([
            "20", "ffmpeg", "-nostdin", "-v", "quiet", "-f", "lavfi", "-i",
        ])
        .arg(format!("testsrc2=s={size}:r={rate}"))
        .args(sound)
        .args([
            "-frames:v",
            "12",
            "-vf",
            &format!("setpts='{times}'"),
            "-fps_mode",
            "passthrough",
        ])
        .args(["-c:v", codec, "-pix_fmt", format])
        .args(&options)
        .arg(&file)
        .status();
    let is_made = made.is_ok_and(|status| status.success());
    let about = format!(
        "{container} {codec} {format} {size} {rate} {times} {}",
        options.join(" ")
    );
    if !is_made || fs::metadata(&file).map_or(0, |file| file.len()) == 0 {
        return None;
    }
    if chance.share() < 0.6 {
        damage(&file, chance);
    }
    Some((file.to_str()?.to_owned(), about))
}

/// Changes bytes, most of them at the beginning and the end, where the fields are.
fn damage(file: &Path, chance: &mut Chance) {
    let mut bytes = fs::read(file).unwrap();
    for _ in 0..1 + chance.below(12) {
        let reach = if chance.share() < 0.8 {
            bytes.len().min(2048)
        } else {
            bytes.len()
        };
        let offset = chance.below(reach);
        let at = if chance.share() < 0.5 {
            offset
        } else {
            bytes.len() - 1 - offset
        };
        bytes[at] = chance.pick(&[0, 1, 0x7f, 0x80, 0xfe, 0xff]);
    }
    fs::write(file, bytes).unwrap();
}

#[test]
fn videos_of_any_fields_are_read_or_refused() {
    let number = variable("OMNILIFE_MEDIA").unwrap_or(VIDEOS);
    let mut chance = Chance::new(variable("OMNILIFE_SEED").unwrap_or(1));
    let folder = scratch();
    let (mut made, mut codes, mut wrong) = (0, [0_usize; 3], Vec::new());
    for draw in 0.. {
        if made == number {
            break;
        }
        if draw == 200 && made == 0 {
            omnilife_schemas::testing::skip("there is no ffmpeg command that makes videos");
            return;
        }
        let Some((video, about)) = make(folder.path(), draw, &mut chance) else {
            continue;
        };
        made += 1;
        let out = format!("{video}.out");
        let curated = [
            "curate",
            &video,
            "--criteria",
            "none",
            "--accept",
            "erp",
            "--width",
            "32",
            "--fps",
            "2",
            "--out",
            &out,
        ];
        let slice = format!("{video}.slice.mp4");
        for words in [
            &["curate", "probe", &video][..],
            &["curate", "projection", &video],
            &["curate", "boundaries", &video],
            &["curate", "slice", &video, "--end", "0.3", "--out", &slice],
            &curated,
        ] {
            let limits = [
                "timeout",
                "--signal=KILL",
                "60",
                "sh",
                "-c",
                "ulimit -v 4000000 && exec \"$0\" \"$@\"",
            ];
            let ended: Ended = omnilife_through(&limits, words);
            if let Some(code @ 0..=2) = ended.code {
                codes[code as usize] += 1;
            }
            if let Some(fault) = ending_fault(&ended) {
                wrong.push(format!("{}: {about}: {fault}", words[1]));
                let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join("hostile-media");
                fs::create_dir_all(&kept).unwrap();
                fs::copy(&video, kept.join(Path::new(&video).file_name().unwrap())).unwrap();
            }
        }
        for left in [&video, &slice] {
            // An unreadable video has no slice.
            drop(fs::remove_file(left));
        }
        omnilife_schemas::store::remove(Path::new(&out)).unwrap();
    }
    let [good, ours, refused] = codes;
    println!("| videos | commands | exit 0 | exit 1 | exit 2 | wrong |\n|--:|--:|--:|--:|--:|--:|");
    println!(
        "| {made} | {} | {good} | {ours} | {refused} | {} |",
        5 * made,
        wrong.len()
    );
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
