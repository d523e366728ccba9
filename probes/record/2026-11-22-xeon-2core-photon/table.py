"""Prints the rows of the README's table from the .json files beside it."""
import json, pathlib
here = pathlib.Path(__file__).parent
for name in ["bump", "caf", "mni"]:
    for light in ["indirect", "gather"]:
        for row in json.loads((here / f"{name}-{light}.json").read_text())["rows"]:
            p, whole, bands = row["photons"], row["whole"], row["band_limited"]
            figure = lambda x: f"{100 * x['value']:.2f} ± {100 * x['half_interval_95']:.2f}"
            print("|", " | ".join([
                name, row["environment"], light, figure(whole["relative_rms"]), f"{whole['rms_percent']:.2f}",
                f"{100 * row['budget_mean_square']['truncation'] ** 0.5:.2f}",
                f"{100 * bands['relative_rms_without_noise']:.2f}", f"{100 * row['reference_noise']:.2f}",
                figure(p["store_against_photons"]["relative_rms"]), figure(p["photons_against_paths"]["relative_rms"]),
                figure(p["photons_against_paths"]["bias"]), f"{100 * p['noise']:.2f}", f"{100 * p['bias_rms']:.2f}",
                f"{p['hits']:,}", f"{p['energy']['imbalance']:.0e}",
            ]), "|")
