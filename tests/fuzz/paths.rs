//! Readers of paths: of cameras, and of drones.

use std::fs;

use omnilife_reconstruct::jobs::camera_path;
use omnilife_tracks::georeference::telemetry::Telemetry;

use crate::{
    samples::names,
    targets::{
        Reader::{Bytes, Folder},
        Target,
    },
};

/// Readers of paths.
pub(crate) const PATHS: &[Target] = &[
    Target {
        id: "camera-path",
        words: &[
            "time_seconds,x,y,z,qw,qx,qy,qz",
            "[]",
            "null",
            "1e999",
            "NaN",
            "\"pose\":",
            "\"rotation_wxyz\":",
        ],
        cost: 1,
        seeds: |folder| {
            let table = "time_seconds,x,y,z,qw,qx,qy,qz\n0,1,2,3,1,0,0,0\n0.5,1,2,4,1,0,0,0\n";
            fs::write(folder.join("a.csv"), table).unwrap();
            let list = r#"[{"time_seconds": 0, "pose": {"rotation_wxyz": [1, 0, 0, 0], "centre": [1, 2, 3]}}]"#;
            fs::write(folder.join("a.json"), list).unwrap();
            names(&["a.csv", "a.json"])
        },
        reader: Folder(|input, seed| drop(camera_path::read_path(&input.path(seed)))),
    },
    Target {
        id: "telemetry",
        words: &[
            "[latitude: ",
            "[longtitude : ",
            "abs_alt: ",
            "GPS(",
            "n/a",
            "BAROMETER:",
            ", H ",
            " --> ",
            "99:59:59,999",
            "-0.0",
        ],
        cost: 1,
        seeds: |folder| {
            let current = "1\n00:00:00,000 --> 00:00:00,033\n[latitude: 48.1] [longitude: 11.5] \
                           [rel_alt: 30.1 abs_alt: 549.3]\n\n2\n00:00:00,033 --> 00:00:00,066\n\
                           [latitude: 48.2] [longitude: 11.6] [rel_alt: 30.2 abs_alt: 549.4]\n";
            let older = "1\n00:00:00,000 --> 00:00:01,000\nGPS(11.5,48.1,16) BAROMETER:30.5\n\n\
                         2\n00:00:01,000 --> 00:00:02,000\nGPS (11.6, 48.2, 17), H 31.50m, H.S 5.20m/s\n";
            fs::write(folder.join("a.srt"), current).unwrap();
            fs::write(folder.join("b.srt"), older).unwrap();
            names(&["a.srt", "b.srt"])
        },
        reader: Bytes(|_, bytes| {
            if let Ok(telemetry) = Telemetry::from_bytes(bytes) {
                for seconds in [-1.0, 0.0, 0.5, 1e9, f64::NAN] {
                    let _ = telemetry.at(seconds);
                }
            }
        }),
    },
];
