"""Write dvc.yaml, for every profile, from what stages import and Hydra composes. Not a stage: `make dag`."""

from pipeline.config import ROOT
from pipeline.dag import write_dag

if __name__ == "__main__":
    for file in write_dag(ROOT):
        print(f"{file.relative_to(ROOT)} written")
