//! Readers of curation: tables of shots, tags, origins, signals and detections.

use std::{fs, path::Path};

use omnilife_curate::{
    annotation::tags,
    boundaries::Signals,
    ledger::formats::{self, Frames},
    origins,
};
use omnilife_schemas::{ground_plane::Plane, progress::Silent, records::Scene, store};
use omnilife_tracks::detectors::{self, DetectorInput};

use crate::{
    samples::{names, write_scene},
    targets::{
        Reader::{Bytes, Folder},
        Target,
    },
};

/// Readers of curation.
pub(crate) const CURATED: &[Target] = &[
    Target {
        id: "ledger",
        words: &[
            "TITLE:",
            "FCM: DROP FRAME",
            "00:00:01:00",
            "Scene Number",
            "[",
            "]",
            "\"annotations\"",
        ],
        cost: 1,
        seeds: |folder| {
            for (name, text) in LEDGERS {
                fs::write(folder.join(name), text).unwrap();
            }
            LEDGERS.iter().map(|(name, _)| (*name).to_owned()).collect()
        },
        reader: Bytes(|_, bytes| {
            let times: Vec<f64> = (0..50).map(|frame| f64::from(frame) / 25.0).collect();
            let frames = Frames {
                times: &times,
                video: "a.mp4",
            };
            if let Ok(text) = std::str::from_utf8(bytes) {
                drop(formats::read_any(text, &frames));
            }
        }),
    },
    Target {
        id: "tags",
        words: &["sequence", "author", "\"", ",", "true", "null"],
        cost: 1,
        seeds: |folder| {
            let table = "sequence,author,scene,action,traversal,caption\nwalk/seq-000,ann,beach,walking,true,Sea.\n";
            fs::write(folder.join("a.csv"), table).unwrap();
            let list =
                "[{\"sequence\": \"walk/seq-000\", \"author\": \"ann\", \"scene\": \"beach\"}]";
            fs::write(folder.join("a.json"), list).unwrap();
            names(&["a.csv", "a.json"])
        },
        reader: Bytes(|seed, bytes| drop(tags::from_bytes(Path::new(&seed.name), bytes))),
    },
    Target {
        id: "origins",
        words: &[
            "file",
            "url",
            "keywords",
            "own-capture",
            "2026-05-31",
            "\"",
            ",",
            ";",
        ],
        cost: 1,
        seeds: |folder| {
            let table = "file,url,uploader,licence,date,keywords,kind\n\
                         a.mp4,https://e.org/v,Ann,CC-BY-4.0,2026-05-31,night;market,web\n";
            fs::write(folder.join("a.csv"), table).unwrap();
            let list = "[{\"file\": \"a.mp4\", \"keywords\": [\"night\"], \"date\": \"2026\"}]";
            fs::write(folder.join("a.json"), list).unwrap();
            names(&["a.csv", "a.json"])
        },
        reader: Bytes(|seed, bytes| drop(origins::from_bytes(Path::new(&seed.name), bytes))),
    },
    Target {
        id: "signals",
        words: &["PAR1", "time_seconds", "luma"],
        cost: 2,
        seeds: |folder| {
            let signals = Signals {
                times: vec![0.0, 0.1, 0.2],
                columns: vec![("luma".to_owned(), vec![0.5, 0.25, 0.125])],
            };
            signals.write_parquet(&folder.join("a.parquet")).unwrap();
            names(&["a.parquet"])
        },
        reader: Folder(|input, seed| drop(Signals::read_parquet(&input.path(seed)))),
    },
    Target {
        id: "detections",
        words: &[
            "\"images\"",
            "\"annotations\"",
            "\"bbox\"",
            "\"file_name\"",
            "-1",
            ",",
            "[]",
        ],
        cost: 2,
        seeds: |folder| {
            write_scene(folder);
            fs::write(
                folder.join("a.txt"),
                "1,-1,2,2,4,4,0.9,-1,-1,-1\n2,1,0,0,16,8,1,1,1\n",
            )
            .unwrap();
            let coco = "{\"images\": [{\"id\": 1, \"file_name\": \"000000.png\"}], \"categories\": \
                        [{\"id\": 3, \"name\": \"car\"}], \"annotations\": [{\"image_id\": 1, \
                        \"category_id\": 3, \"bbox\": [2, 2, 4, 4], \"score\": 0.9}]}";
            fs::write(folder.join("a.json"), coco).unwrap();
            names(&["a.txt", "a.json"])
        },
        reader: Folder(|input, seed| {
            let Ok(scene) = store::read_record::<Scene>(&input.folder.join("scene.json")) else {
                return;
            };
            let request = DetectorInput {
                folder: &input.folder,
                scene: &scene,
                views: &[],
                points: &[],
                ground: Plane {
                    normal: glam::DVec3::Z,
                    offset: 0.0,
                },
                metres_per_unit: 1.0,
                file: Some(&input.path(seed)),
                program: None,
                out: &input.folder,
            };
            drop((detectors::files::DETECTOR.detect)(&request, &Silent));
        }),
    },
];

const LEDGERS: &[(&str, &str)] = &[
    (
        "a.csv",
        "begin_seconds,end_seconds,kind,score\n0.4,0.44,cut,1\n1.0,1.2,gradual,0.7\n",
    ),
    (
        "a.json",
        "[{\"begin_seconds\": 0.4, \"end_seconds\": 0.44, \"kind\": \"cut\", \"score\": 1.0}]",
    ),
    (
        "a.edl",
        "TITLE: a\nFCM: NON-DROP FRAME\n\n001  AX V C 00:00:00:00 00:00:01:00 00:00:00:00 00:00:01:00\n\
               002  AX V C 00:00:01:00 00:00:02:00 00:00:01:00 00:00:02:00\n",
    ),
    ("a.txt", "0 12\n13 30\n31 49\n"),
    (
        "scenes.csv",
        "Scene Number,Start Frame,Start Timecode,Start Time (seconds),End Frame,End Timecode,\
                    End Time (seconds),Length (frames),Length (timecode),Length (seconds)\n\
                    1,1,00:00:00.000,0.000,25,00:00:01.000,1.000,25,00:00:01.000,1.000\n\
                    2,26,00:00:01.000,1.000,50,00:00:02.000,2.000,25,00:00:01.000,1.000\n",
    ),
    (
        "ls.json",
        "[{\"annotations\": [{\"result\": [{\"value\": {\"start\": 0.4, \"end\": 0.5, \
                 \"timelinelabels\": [\"cut\"]}}]}]}]",
    ),
];
