import argparse
import json
import os
import sys

sys.path.append('/home/renjiahui/PanoSplatt3R')
from shutil import copyfile

import hm3d


def main(cfg):
    ckpt = "outputs/random_with_pretrain_no_pose_2dgs_full_reso_xformers/step_100000_psnr_28.180999046148255.pth"
    assert os.path.isabs(ckpt) and ckpt.endswith(".pth")
    to_save_image = False
    scenes = hm3d.read(cfg["roots"], cfg["rgb_roots"], cfg["view_sampler"]["index_path"], cfg["image_shape"])
    for scene, targets in scenes:
        assert len(targets) > 1, "a dimension of one is squeezed"
        if to_save_image:
            folder = os.path.join('result', cfg["name"], scene, "color")
            os.makedirs(folder)
            for index, file in enumerate(targets):
                copyfile(file, os.path.join(folder, f"{index:06}_erp.png"))


if __name__ == '__main__':
    parser = argparse.ArgumentParser()
    parser.add_argument('--dataset', type=str, default='replica', choices=['replica', 'hm3d'])
    arguments = parser.parse_args()
    assert os.path.isfile("config/defalts.yaml")
    assert arguments.dataset == "hm3d"
    # Their YAML reader reads JSON too.
    with open("config/dataset/hm3d_eval.yaml") as file:
        main(json.load(file))
