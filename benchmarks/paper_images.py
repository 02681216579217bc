# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's evaluation on photos: Table 1, Figures 3, 9 and 10, and other filters beside ours."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable
from pathlib import Path

import common
import image_peers
import numpy as np
import schemes
from image_peers import Quality, bilateral, coherence_shock, ours, unsharp
from pictures import sheet
from report import Target, table, targets
from scipy import ndimage
from shock_filter import core

PHOTO = "flower.jpg"
KODAK = ["kodim04.png", "kodim05.png", "kodim08.png", "kodim13.png"]
PAPER_SECONDS = {
    "naive": {1: 0.4, 4: 1.3, 16: 5.0, 64: 19.8, 256: 79.0, 1024: 310.1},
    "composed": {1: 0.4, 4: 1.2, 16: 4.7, 64: 20.0, 256: 77.6, 1024: 308.6},
    "fixed": {1: 0.4, 4: 0.4, 16: 0.5, 64: 0.6, 256: 0.6, 1024: 0.6},
}
SLOW_FROM = 256
BLUR = 1.5
CONVERGED = 0.94
SIGN_STEP = 0.5
FLOW_STEP = 2.0


def table_photo(data: Path) -> np.ndarray:
    """Return a photo of 1368 x 1824 pixels, cut out of the turned one."""
    turned = np.rot90(common.load_image(data, PHOTO))
    top = (len(turned) - 1824) // 2
    left = (turned.shape[1] - 1368) // 2
    return np.ascontiguousarray(turned[top : top + 1824, left : left + 1368].transpose(1, 0, 2))


def blurred(image: np.ndarray) -> np.ndarray:
    """Blur each channel by a Gaussian."""
    smooth = ndimage.gaussian_filter(image.astype(np.float64), (BLUR, BLUR, 0))
    return np.rint(smooth).astype(np.uint8) if image.dtype == np.uint8 else smooth


def fixed(image: np.ndarray, flow_time: float) -> np.ndarray:
    """Sharpen by the flow of the input, as the core does."""
    return core.sharpen_image(image, core.ImageSettings(time=flow_time))


SCHEMES = {"naive": schemes.naive, "composed": schemes.composed, "fixed": fixed}


def warm_up(image: np.ndarray, sharpen: Callable[..., np.ndarray] = fixed) -> None:
    """Load or compile the kernels for images of this type."""
    sharpen(image[:16, :16].copy(), 2.0)


def time_schemes(data: Path, everything: bool) -> dict[str, dict[int, float]]:
    """Seconds by scheme and flow time."""
    image = table_photo(data)
    found: dict[str, dict[int, float]] = {}
    for scheme, paper in PAPER_SECONDS.items():
        warm_up(image, SCHEMES[scheme])
        found[scheme] = {}
        for flow_time in paper:
            if scheme != "fixed" and flow_time >= SLOW_FROM and not everything:
                continue
            runs = 3 if scheme == "fixed" or flow_time <= 4 else 1
            run = functools.partial(SCHEMES[scheme], image, flow_time)
            found[scheme][flow_time] = common.fastest(run, runs)
    return found


def table1(job: common.Job) -> None:
    """Time of the three schemes as the flow time grows."""
    found = common.in_own_process(time_schemes, job.data, job.everything)
    times = list(PAPER_SECONDS["fixed"])
    rows = []
    for scheme, paper in PAPER_SECONDS.items():
        seconds = [found[scheme].get(flow_time) for flow_time in times]
        rows.append([scheme, "ours", *("" if s is None else f"{s:.2f}" for s in seconds)])
        rows.append(["", "paper", *(f"{paper[flow_time]:.1f}" for flow_time in times)])
    fixed = found["fixed"]
    text = [
        "1368 x 1824 pixels, three channels of uint8, one smoothing pass; seconds by flow time t."
        " The fixed flow, and t up to 4: best of three runs; else one run.",
        table(["scheme", "", *(f"t = {flow_time}" for flow_time in times)], rows, words=2),
    ]
    if not job.everything:
        text.append(f"Naive and composed from t = {SLOW_FROM} on take minutes: `--all` runs them.")
    text.append(
        targets(
            [
                Target("fixed, t = 1024: seconds", fixed[1024], 0.35),
                Target("fixed, t = 1024 / t = 1", fixed[1024] / fixed[1], 3.0),
            ]
        )
    )
    job.page.write("table1", "\n\n".join(text))


def distance(one: np.ndarray, other: np.ndarray) -> float:
    """Root mean square difference."""
    return math.sqrt(float(np.square(one - other, dtype=np.float64).mean()))


Curve = list[tuple[float, float, float]]
"""Flow time or steps, seconds, and the share of the way to the end."""


def time_convergence(data: Path) -> dict[str, Curve]:
    """How close each method comes to its steady state, and when."""
    photo = common.load_image(data, PHOTO)
    pad = ((0, 2136 - photo.shape[0]), (0, 2848 - photo.shape[1]), (0, 0))
    image = np.pad(photo, pad, mode="symmetric").astype(np.float32) / 255

    def advected(flow_time: float) -> np.ndarray:
        settings = core.ImageSettings(time=flow_time, smoothing_passes=0)
        return core.sharpen_image(image, settings)

    def by_sign(steps: float) -> np.ndarray:
        return core.osher_rudin_image(image, steps=int(steps), time_step=SIGN_STEP)

    def by_flow(flow_time: float) -> np.ndarray:
        return core.osher_rudin_image(
            image, steps=round(flow_time / FLOW_STEP), time_step=FLOW_STEP, edge_detector="flow"
        )

    def curve(method: Callable, amounts: list[float], end: float) -> Curve:
        found = []
        for amount in [*amounts, end]:
            seconds = [math.inf]
            while len(seconds) <= 3 and sum(seconds[1:]) < 2:
                start = time.perf_counter()
                result = method(amount)
                seconds.append(time.perf_counter() - start)
            found.append((amount, min(seconds), distance(result, image)))
        return [(amount, seconds, moved / found[-1][2]) for amount, seconds, moved in found]

    warm_up(image)
    for detector in ("gradient", "flow"):
        core.osher_rudin_image(image[:8, :8], steps=1, time_step=SIGN_STEP, edge_detector=detector)
    powers = [2.0**k for k in range(1, 10)]
    return {
        "advection": curve(advected, powers + [1024.0, 1536.0], 2048.0),
        "PDE of equation 2": curve(by_flow, powers + [1024.0, 1536.0], 2048.0),
        "advection to t = ∞": curve(advected, [4.0**k for k in range(2, 11)], math.inf),
        "PDE with F = sign": curve(by_sign, [1.0, 2.0, 4.0, 8.0, 16.0, 32.0], 128.0),
    }


def seconds_until(share: float, found: Curve) -> float:
    """Interpolate the seconds that it takes to come so near to the end."""
    _, seconds, shares = zip(*found, strict=True)
    return float(np.interp(share, shares, seconds))


def figure9(job: common.Job) -> None:
    """Time to converge, advection and PDE."""
    found = common.in_own_process(time_convergence, job.data)
    rows = [
        [method, f"{amount:g}", f"{seconds:.2f}", f"{share:.3f}"]
        for method, curve in found.items()
        for amount, seconds, share in curve
    ]
    needed = {method: seconds_until(CONVERGED, curve) for method, curve in found.items()}
    same, other = needed["PDE of equation 2"], needed["PDE with F = sign"]
    goal = Target(
        f"PDE of equation 2 {same:.2f} s / advection {needed['advection']:.2f} s, to {CONVERGED}",
        same / needed["advection"],
        3.0,
        "{:.1f}",
        at_least=True,
    )
    text = [
        "The flower photo, continued by reflection to 2848 x 2136 pixels (float32, three channels),"
        " without smoothing passes; best of three runs, or of those that fit into two seconds.",
        "The advection solves the PDE of equation 2. The PDE runs to the same flow times, in"
        f" steps of {FLOW_STEP:g} (shortened where they would be unstable; longer ones change the"
        " result), and I_∞ is I_2048 for both, as in the paper.",
        targets([goal]),
        "Osher and Rudin's own choice, F = sign, moves weak edges as fast as strong ones. So it"
        " converges much sooner, to another state, in which noise is as sharp as edges: with the"
        f" second derivative along the gradient, in steps of {SIGN_STEP}, the longest stable ones,"
        f" it has gone {CONVERGED} of the way to the state after 128 steps in {other:.2f} s. The"
        f" advection has gone {CONVERGED} of the way to t = ∞ in"
        f" {needed['advection to t = ∞']:.2f} s.",
        "<details><summary>All runs</summary>",
        table(["method", "t or steps", "seconds", "‖I_t - I_0‖ / ‖I_∞ - I_0‖"], rows),
        "</details>",
    ]
    curves = {
        method: ([share for _, _, share in curve], [seconds for _, seconds, _ in curve])
        for method, curve in found.items()
    }
    plot = job.page.plot(
        "figure9", curves, "share of the way to the end", "seconds", x_scale="linear"
    )
    job.page.write("figure9", "\n\n".join(text) + plot)


REACH_TIMES = [4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0, math.inf]


def edge_width(profile: np.ndarray) -> float:
    """Pixels in which a rising profile goes from a tenth to nine tenths of its height."""
    heights = (profile - profile[0]) / (profile[-1] - profile[0])
    ends = np.interp([0.1, 0.9], np.maximum.accumulate(heights), np.arange(len(profile)))
    return float(ends[1] - ends[0])


def reach(job: common.Job) -> None:
    """Width of a blurred step of brightness by flow time."""
    rows = []
    for contrast in (0.8, 0.4, 0.2):
        for sigma in (1.0, 2.0, 4.0):
            step = ndimage.gaussian_filter1d(np.repeat([0.0, contrast], 64), sigma)
            image = np.tile(step, (64, 1))
            widths = [edge_width(step)]
            for flow_time in REACH_TIMES:
                settings = core.ImageSettings(time=flow_time)
                widths.append(edge_width(core.sharpen_image(image, settings)[32]))
            rows.append([f"{contrast}", f"{sigma:g}", *(f"{width:.1f}" for width in widths)])
    text = [
        "A gray image with one straight edge of the given contrast, blurred by a Gaussian: pixels"
        " from a tenth to nine tenths of the contrast, before and after.",
        table(["contrast", "sigma", "before", *(f"t = {t:g}" for t in REACH_TIMES)], rows),
    ]
    job.page.write("reach", "\n\n".join(text))


STEPS = 1024
CROP = (slice(60, 444), slice(200, 584))
DETAIL = [(slice(100, 180), slice(60, 160)), (slice(230, 310), slice(200, 300))]


def compare_schemes(data: Path) -> tuple[dict[str, np.ndarray], list[list[float]]]:
    """Results of the schemes; agreement of advection and PDE, sharp photo and blurred one."""
    photo = common.load_image(data, "kodim05.png")[CROP].astype(np.float32) / 255
    image = blurred(photo).astype(np.float32)
    results = {"input": image}
    results |= {scheme: sharpen(image, STEPS) for scheme, sharpen in SCHEMES.items()}
    agreement = []
    for given in (photo, image):
        steady = core.sharpen_image(given, core.ImageSettings(time=math.inf, smoothing_passes=0))
        end = core.osher_rudin_image(given, steps=500, time_step=SIGN_STEP)
        slopes = [image_peers.gradient_magnitude(each).ravel() for each in (given, steady, end)]
        agreement.append(
            [
                float(np.corrcoef(slopes[1], slopes[2])[0, 1]),
                float(np.corrcoef(slopes[0], slopes[1])[0, 1]),
                float(np.corrcoef(slopes[0], slopes[2])[0, 1]),
                distance(steady, end),
                distance(steady, given),
            ]
        )
    return results, agreement


def as_bytes(image: np.ndarray) -> np.ndarray:
    """Turn floats in [0, 1] into uint8."""
    return np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)


def figure3(job: common.Job) -> None:
    """Results of the schemes, and agreement of advection and PDE."""
    results, agreement = common.in_own_process(compare_schemes, job.data)
    fixed = results["fixed"]
    squares = {
        name: float((image_peers.gradient_magnitude(image) ** 2).mean())
        for name, image in results.items()
    }
    smoothness = squares["naive"] / squares["composed"]
    rows = [
        [
            name,
            f"{255 * distance(image, fixed):.2f}",
            f"{255 * distance(image, results['input']):.2f}",
            f"{squares[name] / squares['input']:.3f}",
        ]
        for name, image in results.items()
    ]
    pairs = zip(("as it is", f"blurred, sigma {BLUR}"), agreement, strict=True)
    agreed = [
        [
            photo,
            *(f"{value:.3f}" for value in values[:3]),
            *(f"{255 * value:.2f}" for value in values[3:]),
        ]
        for photo, values in pairs
    ]
    text = [
        f"384 x 384 pixels of a Kodak photo, blurred by a Gaussian with a sigma of {BLUR} pixels,"
        f" t = {STEPS}, one smoothing pass. Differences are root"
        " mean squares in levels of 255; the squared gradient is the mean one over the input's.",
        table(["", "to fixed", "to the input", "squared gradient"], rows),
        "Steady states of the advection and of the PDE (500 steps), without smoothing passes:"
        " correlations of gradient magnitudes, and differences in levels of 255.",
        table(
            ["photo", "advection ~ PDE", "input ~ advection", "input ~ PDE",
             "advection to PDE", "advection to input"],
            agreed,
        ),
        targets(
            [
                Target(
                    "difference of fixed and composed / of fixed and input",
                    distance(results["composed"], fixed) / distance(results["input"], fixed),
                    1.0,
                ),
                Target("squared gradient, naive / composed", smoothness, 1.0),
            ]
        ),
    ]  # fmt: skip
    crops = [[as_bytes(image[part]) for image in results.values()] for part in DETAIL]
    about = "Crops of a photo: input, naive, composed and fixed flow"
    picture = job.page.picture("figure3", sheet(list(results), crops, 2), about)
    job.page.write("figure3", "\n\n".join(text) + picture)


def compare_filters(data: Path) -> list[list[np.ndarray]]:
    """Crops of a photo: input, ours, and smoothing filters that keep edges."""
    image = common.load_image(data, "kodim08.png")
    filters = [lambda given: given, ours(4.0), ours(16.0), bilateral(50, 3)]
    filters += [image_peers.total_variation(0.1), image_peers.perona_malik(40, 0.06)]
    results = [function(image) for function in filters]
    parts = [(slice(160, 230), slice(310, 390)), (slice(335, 405), slice(135, 215))]
    return [[result[part] for result in results] for part in parts]


FIGURE10 = [
    "input",
    "ours, t = 4",
    "ours, t = 16",
    "bilateral",
    "total variation",
    "diffusion",
]


def figure10(job: common.Job) -> None:
    """Pictures beside smoothing filters that keep edges."""
    if not has_libraries():
        return
    crops = common.in_own_process(compare_filters, job.data)
    about = "Crops of a photo: " + ", ".join(FIGURE10)
    picture = job.page.picture("figure10", sheet(FIGURE10, crops, 2), about)
    job.page.write(
        "figure10",
        "A Kodak photo. Bilateral: OpenCV, sigmas of 50 levels and 3 pixels; total variation:"
        " scikit-image, weight 0.1; diffusion: Perona and Malik's, 40 steps, contrast 0.06."
        + picture,
    )


def has_libraries() -> bool:
    """Tell whether the other filters can be imported."""
    opencv = image_peers.available("cv2", "opencv-python-headless")
    return image_peers.available("skimage", "scikit-image") and opencv


def filter_photo(data: Path) -> dict[str, tuple[Quality, Quality, float]]:
    """By filter: quality on the large photo, mean quality on the Kodak photos, seconds."""
    sharp = [table_photo(data)] + [common.load_image(data, name) for name in KODAK]
    given = [blurred(image) for image in sharp]
    filters = {
        "blurred input": (lambda image: image),
        "Shock Filter, t = 64": ours(64.0),
        "Shock Filter, t = 256": ours(256.0),
        "Shock Filter, t = 1024": ours(1024.0),
        "Shock Filter, t = 4096": ours(4096.0),
        "Shock Filter, t = ∞": ours(math.inf),
    }
    if has_libraries():
        filters |= {
            "scikit-image unsharp_mask, radius 1, amount 1": unsharp(1.0, 1.0),
            f"scikit-image unsharp_mask, radius {BLUR}, amount 2": unsharp(BLUR, 2.0),
            "OpenCV bilateralFilter, 25 levels, 3 pixels": bilateral(25, 3),
            "coherence-enhancing shock on OpenCV, 4 turns": coherence_shock(),
        }
    found = {}
    for name, function in filters.items():
        results, seconds = [], math.nan
        for image in given:
            if results:
                results.append(function(image))
            else:
                first, seconds = image_peers.timed(function, image)
                results.append(first)
        found[name] = (*_qualities(results, given, sharp), seconds)
    if image_peers.has_gmic():
        runs = [image_peers.gmic(image) for image in given]
        results = [result for result, _ in runs]
        name = "G'MIC " + " ".join(image_peers.GMIC_SHOCK[:2])
        found[name] = (*_qualities(results, given, sharp), runs[0][1])
    return found


def _qualities(results: list, given: list, sharp: list) -> tuple[Quality, Quality]:
    photo, *others = map(Quality.of, results, given, sharp)
    names = Quality.__dataclass_fields__
    mean = Quality(**{n: float(np.mean([getattr(q, n) for q in others])) for n in names})
    return photo, mean


def peers(job: common.Job) -> None:
    """Other filters on photos whose sharp original is known."""
    found = common.in_own_process(filter_photo, job.data)
    head = ["filter", "seconds", "outside", "by levels", "slope", "PSNR, dB"]

    def rows(index: int) -> list[list[str]]:
        return [
            [
                name,
                "" if name == "blurred input" or index else f"{values[2]:.2f}",
                f"{values[index].outside:.1%}",
                f"{values[index].excess:.1f}",
                f"{values[index].slope:.2f}",
                f"{values[index].psnr:.2f}",
            ]
            for name, values in found.items()
        ]

    text = [
        f"Photos blurred by a Gaussian with a sigma of {BLUR} pixels. *Outside*: the share of"
        " values that leave the range of the input's 5 x 5 pixels around them, and by how many"
        " levels of 255 in the mean. *Slope*: the 95th percentile of the gradient over the sharp"
        " photo's (1 is as steep as the original). *PSNR* to the sharp photo. Best of three runs.",
        "The photo of 1368 x 1824 pixels:",
        table(head, rows(0)),
        "Mean of four Kodak photos of 768 x 512 pixels:",
        table([head[0], *head[2:]], [[row[0], *row[2:]] for row in rows(1)]),
    ]
    rival = [values for name, values in found.items() if name.startswith("G'MIC")]
    if rival:
        faster = rival[0][2] / found["Shock Filter, t = 1024"][2]
        what = "times faster than G'MIC, t = 1024"
        text.append(targets([Target(what, faster, 4.0, "{:.1f}", at_least=True)]))
    job.page.write("peers", "\n\n".join(text))
