DATASETS_CONFIG = {"waymo": {0: {"camera_name": "front_camera", "original_size": (1280, 1920)}}}
