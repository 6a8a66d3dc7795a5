//! Origins of videos, from a list into the dataset, its card, and the next run.

use std::fs;

use omnilife_curate::{
    CurateSettings, curate_dataset, origins,
    publish::{PublishSettings, publish, verify},
};
use omnilife_schemas::{
    layout::DATASET_FILE,
    progress::Silent,
    records::{Dataset, OriginKind, Sampling},
    store,
    testing::Notes,
};
use support::erp_clip;

use crate::support;

#[test]
fn a_list_goes_into_the_record_and_the_card_and_stays() {
    let folder = tempfile::tempdir().unwrap();
    let walk = erp_clip(folder.path(), "walk.mp4", &[1], 12, 10);
    let ride = erp_clip(folder.path(), "ride.mp4", &[3], 12, 10);
    let (videos, out) = ([walk.clone(), ride], folder.path().join("set"));
    let settings = CurateSettings {
        enforce: false,
        sampling: Sampling::MaxFrames(2),
        ..CurateSettings::default()
    };
    let list = folder.path().join("list.csv");
    let enter = |text: String| {
        fs::write(&list, text).unwrap();
        let notes = Notes::default();
        let mut curated = curate_dataset(&videos, &out, &settings, &Silent).unwrap();
        assert!(curated.errors.is_empty(), "{:?}", curated.errors);
        let read = origins::read(&list).unwrap();
        read.enter(&list, &videos, &mut curated.record, &out, &notes)
            .unwrap();
        drop(curated);
        notes.take()
    };
    let record = || store::read_record::<Dataset>(&out.join(DATASET_FILE)).unwrap();

    // By its path, and another file that is not there.
    let notes = enter(format!(
        "file,url,licence,keywords,kind\n{},https://e.org/a|b,CC-BY-4.0,night;<b>market,web\n\
         gone.mp4,,,,own-capture\n",
        walk.display()
    ));
    assert_eq!(notes.len(), 2, "{notes:?}");
    assert!(notes[0].contains("ride.mp4: ") && notes[0].ends_with("list.csv says nothing of it"));
    assert!(notes[1].ends_with("list.csv: gone.mp4 is not one of the videos"));
    let origin = record().videos[0].origin.clone().unwrap();
    assert_eq!(origin.url.as_deref(), Some("https://e.org/a|b"));
    assert_eq!(origin.kind, Some(OriginKind::Web));
    assert_eq!(record().videos[1].origin, None);

    publish(&out, &PublishSettings::default(), &Silent).unwrap();
    let card = fs::read_to_string(out.join("README.md")).unwrap();
    assert!(
        card.contains("Origins of 1 of 2 videos, as stated"),
        "{card}"
    );
    assert!(
        card.contains(
            "| walk.mp4 | web https://e.org/a\\|b |  | CC-BY-4.0 |  | night, \\<b>market |"
        ),
        "{card}"
    );
    assert_eq!(verify(&out, &Silent).unwrap(), [""; 0]);

    // The next run says nothing of it and keeps it; the next list, by file name, replaces it.
    let curated = curate_dataset(&videos, &out, &settings, &Silent).unwrap();
    assert_eq!(curated.record.videos[0].origin, Some(origin));
    drop(curated);
    let notes = enter("file,date\nwalk.mp4,2026-05\nride.mp4,2025\n".to_owned());
    assert!(notes.is_empty(), "{notes:?}");
    let origins = record().videos;
    let dates = origins
        .iter()
        .map(|video| video.origin.as_ref().unwrap().date.clone().unwrap());
    assert_eq!(dates.collect::<Vec<_>>(), ["2026-05", "2025"]);
    assert_eq!(origins[0].origin.as_ref().unwrap().url, None);
}
