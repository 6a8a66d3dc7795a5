from pathlib import Path

import waymo
from datasets.dataset_meta import DATASETS_CONFIG


class DrivingDataset:
    def __init__(self, found, known):
        size = DATASETS_CONFIG["waymo"][0]["original_size"]
        assert found["data.pixel_source.load_smpl"] == "False" and found["trainer.losses.mask.w"] == "0"
        assert found["render.render_novel"] == "null" and "SMPLNodes" not in known
        self.files = waymo.read(Path(found["data.data_root"]), size, known)
