//! What is read, and the valid files that changes begin from.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_bench::external::manifest::Manifest;
use omnilife_curate::{
    annotation::tags,
    criteria,
    exchange::{self, ImportRequest},
    ledger::formats::{self, Frames},
    poses::colmap::ColmapModel,
    video,
};
use omnilife_reconstruct::formats::ply;
use omnilife_schemas::{
    Pose, RgbImage, Similarity,
    camera::ErpCamera,
    frame_scores::FrameScores,
    image_file::ImageFile,
    npy,
    points::PointCloud,
    progress::Silent,
    records::{PoseSource, PoseValidation, Scale, Scene, SceneFrame, ValidationStatus, check_file},
    store,
};

/// A file that a reader takes.
pub(crate) struct Seed {
    /// Its name, relative to the folder.
    pub(crate) name: String,
    pub(crate) bytes: Vec<u8>,
}

/// A folder that holds the seeds, one of them changed.
pub(crate) struct Input {
    pub(crate) folder: PathBuf,
    pub(crate) seeds: Vec<Seed>,
}

impl Input {
    /// Reads the seeds of a folder by their names.
    pub(crate) fn new(folder: &Path, names: Vec<String>) -> Self {
        let seed = |name: String| Seed {
            bytes: fs::read(folder.join(&name)).unwrap(),
            name,
        };
        Self {
            folder: folder.to_owned(),
            seeds: names.into_iter().map(seed).collect(),
        }
    }

    fn path(&self, seed: &Seed) -> PathBuf {
        self.folder.join(&seed.name)
    }
}

/// A reader.
pub(crate) struct Target {
    pub(crate) id: &'static str,
    /// Words of its format.
    pub(crate) words: &'static [&'static str],
    /// How many times as long as others it takes.
    pub(crate) cost: u64,
    /// Fills a folder with files that the reader takes, and names those that are changed.
    pub(crate) seeds: fn(&Path) -> Vec<String>,
    /// Reads the changed file; what it returns does not matter.
    pub(crate) read: fn(&Input, &Seed),
}

/// All readers.
pub(crate) const TARGETS: &[Target] = &[
    Target {
        id: "npy",
        words: &["'descr'", "'<f4'", "'<f8'", "(3, 4)", "True", "\n"],
        cost: 1,
        seeds: |folder| {
            let values: Vec<f32> = (0..12_u8).map(f32::from).collect();
            npy::write_f32(&folder.join("a.npy"), &[3, 4], &values).unwrap();
            names(&["a.npy"])
        },
        read: |input, seed| drop(npy::read(&input.path(seed))),
    },
    Target {
        id: "points",
        words: PLY_WORDS,
        cost: 1,
        seeds: |folder| {
            cloud().write_ply(&folder.join("a.ply")).unwrap();
            let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
                        property float z\nend_header\n1 2 3\n";
            fs::write(folder.join("b.ply"), text).unwrap();
            names(&["a.ply", "b.ply"])
        },
        read: |input, seed| drop(PointCloud::read_ply(&input.path(seed))),
    },
    Target {
        id: "gaussians",
        words: PLY_WORDS,
        cost: 1,
        seeds: |folder| {
            fs::write(folder.join("a.ply"), gaussians()).unwrap();
            names(&["a.ply"])
        },
        read: |input, seed| drop(ply::read(&input.path(seed), &unchanged())),
    },
    Target {
        id: "frame-scores",
        words: &["view", "input", "novel", ",", "\"", "\n", "inf"],
        cost: 1,
        seeds: |folder| {
            let text = "view,frame,time_seconds,psnr,ssim\ninput,0,0,31.25,0.91\nnovel,5,0.5,,\n";
            fs::write(folder.join("frames.csv"), text).unwrap();
            names(&["frames.csv"])
        },
        read: |input, seed| drop(FrameScores::read(&input.path(seed))),
    },
    Target {
        id: "image",
        words: &["IHDR", "IDAT", "PLTE", "tRNS", "eXIf", "IEND"],
        cost: 2,
        seeds: |folder| {
            RgbImage::black(16, 8)
                .write_png(&folder.join("a.png"))
                .unwrap();
            names(&["a.png"])
        },
        read: |input, seed| {
            let path = input.path(seed);
            drop(ImageFile::open(&path).and_then(ImageFile::decode));
        },
    },
    Target {
        id: "records",
        words: &[
            "null",
            "[]",
            "{}",
            "\"\"",
            "true",
            "\"schema\":",
            "omnilife/scene/1",
        ],
        cost: 1,
        seeds: |folder| {
            write_scene(folder);
            let poses = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/street/poses.json");
            fs::copy(poses, folder.join("poses.json")).unwrap();
            names(&["scene.json", "poses.json"])
        },
        read: |input, seed| drop(check_file(&input.path(seed))),
    },
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
        read: |input, seed| {
            let times: Vec<f64> = (0..50).map(|frame| f64::from(frame) / 25.0).collect();
            let frames = Frames {
                times: &times,
                video: "a.mp4",
            };
            if let Ok(text) = fs::read_to_string(input.path(seed)) {
                drop(formats::read_any(&text, &frames));
            }
        },
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
        read: |input, seed| drop(tags::read(&input.path(seed))),
    },
    Target {
        id: "method",
        words: &[
            "[render]",
            "[train]",
            "{work}",
            "{frame:06}",
            "{{",
            "}}",
            "command = [",
            "= true",
        ],
        cost: 1,
        seeds: |folder| {
            let text = "id = \"m\"\ntime_limit_seconds = 60\n[render]\ncommand = [\"r\", \"{scene}\"]\n\
                        [predictions]\nnovel = \"{work}/{frame:06}.png\"\n";
            fs::write(folder.join("method.toml"), text).unwrap();
            names(&["method.toml"])
        },
        read: |input, seed| drop(Manifest::read(&input.path(seed))),
    },
    Target {
        id: "criteria",
        words: &["[", "]", "=", "true", "longer_than_seconds", "[thresholds]"],
        cost: 1,
        seeds: |folder| {
            let text = "name = \"own\"\n[thresholds]\nleast_frames_per_second = 24.0\nlonger_than_seconds = 10.0\n";
            fs::write(folder.join("own.toml"), text).unwrap();
            names(&["own.toml"])
        },
        read: |input, seed| {
            let path = input.path(seed);
            drop(criteria::criteria(&path.display().to_string(), &path));
        },
    },
    Target {
        id: "colmap",
        words: &["EQUIRECTANGULAR", "PINHOLE", "#", "\n", "1 2 3"],
        cost: 2,
        seeds: |folder| exported(folder, "colmap"),
        read: |input, seed| {
            let path = input.path(seed);
            if let Some(folder) = path.parent() {
                drop(ColmapModel::read(folder).map(|model| model.cloud()));
            }
            import(input, "colmap");
        },
    },
    Target {
        id: "nerfstudio",
        words: &["null", "[]", "\"transform_matrix\"", "\"file_path\"", "../"],
        cost: 10,
        seeds: |folder| exported(folder, "nerfstudio"),
        read: |input, _| import(input, "nerfstudio"),
    },
    Target {
        id: "openmvg",
        words: &[
            "null",
            "[]",
            "\"extrinsics\"",
            "\"key\"",
            "\"ptr_wrapper\"",
            "2147483649",
        ],
        cost: 10,
        seeds: |folder| exported(folder, "openmvg"),
        read: |input, _| import(input, "openmvg"),
    },
    Target {
        id: "hm3d",
        words: &["'descr'", "'<f4'", "(3, 3, 3)"],
        cost: 10,
        seeds: |folder| exported(folder, "hm3d"),
        read: |input, _| import(input, "hm3d"),
    },
    Target {
        id: "mp4",
        words: &[
            "moov", "trak", "uuid", "st3d", "sv3d", "proj", "equi", "stsd", "tkhd", "colr", "mdat",
        ],
        cost: 10,
        seeds: |folder| {
            let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/street/street.mp4");
            fs::copy(sample, folder.join("a.mp4")).unwrap();
            names(&["a.mp4"])
        },
        read: |input, seed| drop(video::probe(&input.path(seed))),
    },
];

const PLY_WORDS: &[&str] = &[
    "element vertex ",
    "element face ",
    "property float x\n",
    "property list uchar int i\n",
    "double",
    "uchar",
    "format ascii 1.0\n",
    "format binary_little_endian 1.0\n",
    "end_header\n",
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

/// The similarity that leaves the world as it is.
fn unchanged() -> Similarity {
    Similarity {
        offset: [0.0; 3],
        scale: 1.0,
    }
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

fn cloud() -> PointCloud {
    PointCloud {
        positions: vec![[0.0, 1.0, 2.0], [1.0, -1.0, 3.0]],
        colours: vec![[255, 0, 0], [0, 128, 255]],
    }
}

/// Two Gaussians of degree 0 as 3DGS writes them.
fn gaussians() -> Vec<u8> {
    let mut properties = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"].to_vec();
    properties.extend([
        "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
    ]);
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 2\n".to_vec();
    for property in &properties {
        bytes.extend(format!("property float {property}\n").bytes());
    }
    bytes.extend(b"end_header\n");
    for value in 0..2 * properties.len() {
        bytes.extend((value as f32 * 0.1).to_le_bytes());
    }
    bytes
}

/// A scene of three small images, with points.
fn write_scene(folder: &Path) {
    let frame = |number: usize| SceneFrame {
        image: format!("frames/{number:06}.png"),
        time_seconds: 0.1 * number as f64,
        pose: Some(Pose {
            rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
            centre: [number as f64, 0.0, 0.0],
        }),
        mask: None,
        classes: [].into(),
        objects: [].into(),
        depth: None,
        depth_prior: None,
    };
    let scene = Scene {
        id: "a/seq-000".to_owned(),
        camera: ErpCamera {
            width: 16,
            height: 8,
        }
        .into(),
        scale: Scale::Metres,
        frames: (0..3).map(frame).collect(),
        points: Some("points.ply".to_owned()),
        pose_source: PoseSource::Given {
            file: "poses.json".to_owned(),
        },
        validation: PoseValidation {
            status: ValidationStatus::Valid,
            registered_frames: 3,
            total_frames: 3,
            measures: [].into(),
            problems: Vec::new(),
        },
    };
    fs::create_dir_all(folder.join("frames")).unwrap();
    for frame in &scene.frames {
        let file = folder.join(&frame.image);
        RgbImage::black(16, 8).write_png(&file).unwrap();
    }
    cloud().write_ply(&folder.join("points.ply")).unwrap();
    store::write_record(&folder.join("scene.json"), &scene).unwrap();
}

/// A scene in another tool's format, in the folder `in`; the files that are no images are changed.
fn exported(folder: &Path, format: &str) -> Vec<String> {
    let (scene, out) = (folder.join("scene"), folder.join("in"));
    write_scene(&scene);
    let request = exchange::ExportRequest {
        scene_folder: &scene,
        format,
        split: None,
        given_only: false,
        cube_faces: None,
        out: &out,
    };
    exchange::export(&request, &Silent).unwrap();
    let mut found = Vec::new();
    let mut folders = vec!["in".to_owned()];
    while let Some(next) = folders.pop() {
        for name in store::names_in(&folder.join(&next)).unwrap() {
            let name = format!("{next}/{name}");
            if folder.join(&name).is_dir() {
                folders.push(name);
            } else if !name.ends_with(".png") {
                found.push(name);
            }
        }
    }
    found.sort();
    found
}

fn import(input: &Input, format: &str) {
    let out = input.folder.join("out");
    drop(exchange::import(&ImportRequest {
        folder: &input.folder.join("in"),
        format,
        id: "a",
        frames_per_second: Some(10.0),
        out: &out,
    }));
    store::remove(&out).unwrap();
}
