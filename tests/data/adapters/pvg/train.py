from pathlib import Path

import loader

settings = loader.settings()
train, test = loader.read(settings)
assert train and test
model = Path(settings["model_path"])
model.mkdir(parents=True)
(model / "chkpnt30000.pth").write_text("30000")
