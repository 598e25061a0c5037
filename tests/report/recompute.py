# Computes the metrics of one recording from their definitions, with h5py and numpy alone, and compares them with those
# that haptrace printed. Prints every difference beyond one per cent; prints nothing when all agree.
#   recompute.py RECORDING.h5 PRINTED.json
# PRINTED.json: {"figures": {...}, "plant": {"mass": [3], "viscous": [3], "coulomb": [3], "gravity": [3]},
#                "reach": {...}}, the last one as in the recording's config, for a reach only
import json
import sys

import h5py
import numpy as np


def norms(v):
    return np.sqrt((v * v).sum(axis=1))


def trapezoid(y, step):
    return step * (y.sum() - (y[0] + y[-1]) / 2)


class Curve:
    def __init__(self, points):
        keep = np.r_[True, norms(np.diff(points, axis=0)) > 0]
        self.p = points[keep]
        self.s = np.r_[0, np.cumsum(norms(np.diff(self.p, axis=0)))]
        self.length = self.s[-1]

    def at(self, s):
        return np.stack([np.interp(s, self.s, self.p[:, i]) for i in range(3)], axis=-1)

    def foot(self, x, low, high):
        a, b = self.p[:-1], self.p[1:]
        use = (self.s[1:] >= low) & (self.s[:-1] <= high)
        a, d, s = a[use], (b - a)[use], self.s[:-1][use]
        u = np.clip(((x - a) * d).sum(axis=1) / (d * d).sum(axis=1), 0, 1)
        best = np.argmin(norms(a + u[:, None] * d - x))
        return s[best] + u[best] * np.sqrt((d[best] ** 2).sum())

    def resampled(self, spacing):
        return self.at(np.linspace(0, self.length, max(int(round(self.length / spacing)), 1) + 1))


def time_mean(t, y):  # each row has half of the time to its neighbours
    w = np.zeros(len(t))
    w[1:] += np.diff(t) / 2
    w[:-1] += np.diff(t) / 2
    return (w * y).sum() / w.sum()


def by_arc_length(arc, force, length, spacing=1e-3, parts=60):
    cells = int(np.ceil(length / spacing))
    total, passed = np.zeros((cells, 3)), np.zeros(cells)
    for u in (np.arange(parts) + 0.5) / parts:
        s = arc[:-1] + u * np.diff(arc)
        f = force[:-1] + u * np.diff(force, axis=0)
        w = np.abs(np.diff(arc)) / parts
        cell = np.clip((s / spacing).astype(int), 0, cells - 1)
        np.add.at(passed, cell, w)
        for axis in range(3):
            np.add.at(total[:, axis], cell, w * f[:, axis])
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(passed[:, None] > 1e-9, total / passed[:, None], np.nan)


def low_passed(t, x):  # evenly at 1 kHz, the mean of each step, and a zero-phase Butterworth low pass at 10 Hz
    rate = 1000.0
    steps = max(round((t[-1] - t[0]) * rate), 2)
    step = (t[-1] - t[0]) / steps
    slope = np.diff(x, axis=0) / np.diff(t)[:, None]
    area = np.vstack([np.zeros(3), np.cumsum(np.diff(t)[:, None] * (x[1:] + x[:-1]) / 2, axis=0)])

    def integral(at):
        i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
        dt = (at - t[i])[:, None]
        return area[i] + dt * (x[i] + dt * slope[i] / 2)

    grid = t[0] + step * np.arange(steps + 1)
    even = np.empty((steps + 1, 3))
    even[0], even[-1] = x[0], x[-1]
    even[1:-1] = (integral(grid[1:-1] + step / 2) - integral(grid[1:-1] - step / 2)) / step
    line = even[0] + np.arange(steps + 1)[:, None] / steps * (even[-1] - even[0])
    odd = even - line
    whole = np.vstack([odd, -odd[-2:0:-1]])
    f = np.fft.rfftfreq(len(whole), step)
    one_pass = 10 / (np.sqrt(2) - 1) ** 0.25
    ratio = np.tan(np.minimum(np.pi * f * step, np.pi / 2 - 1e-9)) / np.tan(np.pi * one_pass * step)
    return np.fft.irfft(np.fft.rfft(whole, axis=0) / (1 + ratio ** 4)[:, None], len(whole), axis=0)[: steps + 1] + line, step


def sparc(v, rate):
    n = 2 ** (int(np.ceil(np.log2(len(v)))) + 4)
    spectrum = np.abs(np.fft.fft(v, n))[: int(10 / rate * n) + 1]
    spectrum /= spectrum[0]
    spectrum = spectrum[: np.nonzero(spectrum >= 0.05)[0][-1] + 1]
    return -np.hypot(1 / (len(spectrum) - 1), np.diff(spectrum)).sum()


def log_jerk(v, peak):
    bend = np.diff(v, 2, axis=0)
    return -np.log(len(v) ** 3 / peak ** 2 * (bend * bend).sum())


def peaks_of(v, prominence):
    count, low, high, up = 0, v[0], v[0], False
    for x in v:
        if up:
            high = max(high, x)
            if x <= high - prominence:
                count, up, low = count + 1, False, x
        else:
            low = min(low, x)
            if x >= low + prominence:
                up, high = True, x
    return count


def shape_distance(path, hand):
    kept = [hand[0]]
    for p in hand:
        if np.sqrt(((p - kept[-1]) ** 2).sum()) >= 1e-3:
            kept.append(p)
    a, b = path.resampled(1e-3), Curve(np.array(kept)).resampled(1e-3)
    d = np.sqrt(((a[:, None] - b[None]) ** 2).sum(axis=2))
    g = np.full((len(a) + 1, len(b) + 1), np.inf)
    for i in range(len(a)):
        for j in range(len(b)):
            before = d[i, j] if i == j == 0 else min(g[i, j + 1], g[i + 1, j], g[i, j] + d[i, j])
            g[i + 1, j + 1] = before + d[i, j]
    return g[-1, -1] / (len(a) + len(b))


def add_movement(out, t, x, force, plant, covered):
    p, step = low_passed(t, x)
    v = np.gradient(p, step, axis=0)
    speed = norms(v)
    peak = speed.max()
    slow = 0.05 * peak
    fast = np.nonzero(speed >= slow)[0]
    first, last = fast[0], fast[-1]

    def crossing(a, b):
        return (a + (slow - speed[a]) / (speed[b] - speed[a]) * (b - a)) * step

    onset = crossing(first - 1, first) if first > 0 else 0
    end = crossing(last + 1, last) if last + 1 < len(speed) else t[-1] - t[0]
    moving = slice(first, last + 1)
    low, high = np.minimum(speed[first:last], speed[first + 1:last + 1]), np.maximum(speed[first:last], speed[first + 1:last + 1])
    share = np.where(high < slow, 1, np.where(low < slow, (slow - low) / np.maximum(high - low, 1e-300), 0))
    out["movement_time_s"] = end - onset
    out["dwell_time_s"] = share.sum() * step
    out["path_length_m"] = trapezoid(speed[moving], step)
    out["mean_speed_m_per_s"] = out["path_length_m"] / out["movement_time_s"]
    out["peak_speed_m_per_s"] = peak
    out["speed_peaks"] = peaks_of(speed, max(0.05 * peak, 2e-3))
    out["sparc"] = sparc(speed[moving], 1 / step)
    out["log_jerk"] = log_jerk(speed[moving], speed[moving].max())
    out["log_jerk_vector"] = log_jerk(v[moving], speed[moving].max())
    if covered:
        out["normalised_length"] = out["path_length_m"] / covered
    f = low_passed(t, force)[0][moving]
    v, speed, p = v[moving], speed[moving], p[moving]
    power = (f * v).sum(axis=1)
    along = (f * v).sum(axis=1) / speed
    across = np.sqrt(np.maximum((f * f).sum(axis=1) - along ** 2, 0))
    inside = speed >= slow
    out["mean_force_n"] = trapezoid(norms(f), step) / ((len(f) - 1) * step)
    out["mean_force_across_n"] = trapezoid(across * inside, step) / trapezoid(inside * 1.0, step)
    out["assist_work_j"] = trapezoid(np.maximum(power, 0), step)
    out["resist_work_j"] = trapezoid(np.maximum(-power, 0), step)
    out["peak_force_n"] = norms(force).max()
    mass, viscous, coulomb, gravity = (np.array(plant[k]) for k in ("mass", "viscous", "coulomb", "gravity"))
    kinetic = 0.5 * (mass * v * v).sum(axis=1)
    friction = trapezoid((viscous * v * v + coulomb * np.abs(v)).sum(axis=1), step)
    out["person_work_estimate_j"] = (kinetic[-1] - kinetic[0] + friction - trapezoid((gravity * v).sum(axis=1), step)
                                     - out["assist_work_j"] + out["resist_work_j"])


def add_reach(out, t, x, force, reach):  # the trial begins with the cue
    p, step = low_passed(t, x)
    v = np.gradient(p, step, axis=0)
    speed = norms(v)
    fast = np.nonzero(speed >= 0.05 * speed.max())[0]
    first, last = fast[0], fast[-1]
    top = first
    for i in range(first, last + 1):
        if speed[i] > speed[top]:
            top = i
        if speed[i] <= speed[top] - max(0.05 * speed.max(), 2e-3):
            break
    rise = np.arange(top)[(speed[:top] >= 0.1 * speed[top]) & (speed[:top] <= 0.6 * speed[top])]
    w = (1 - np.sqrt(1 - np.sqrt(speed[rise] / speed[top]))) / 2
    start_of_rise = np.polyfit(w, rise * step, 1)[1]
    if 0.1 <= start_of_rise <= 1:
        out["reaction_time_s"] = start_of_rise
    start, target, left = (np.array(reach[key]) for key in ("start_m", "target_m", "lateral"))
    distance = np.sqrt(((target - start) ** 2).sum())
    ahead = (target - start) / distance
    aim = p[top] - p[first]
    out["initial_direction_error_rad"] = np.arctan2(aim @ left, aim @ ahead)
    out["completion"] = np.clip(((x - start) @ ahead).max() / distance, 0, 1)
    out["path_ratio"] = norms(np.diff(p[first:last + 1], axis=0)).sum() / distance
    out["end_error_m"] = np.sqrt(((p[last] - target) ** 2).sum())
    if reach["field_block"] and reach["kind"] == "plain":
        ideal = v[first:last + 1] @ np.array(reach["field_n_s_per_m"]).T
        out["field_share"] = (low_passed(t, force)[0][first:last + 1] * ideal).sum() / (ideal ** 2).sum()
    name = {"plain": "lateral_deviation_m", "catch": "after_effect_m"}.get(reach["kind"])
    if name:
        out[name] = (p[np.argmax(speed)] - start) @ left
        return
    off = p[first:last + 1] - start
    out["lateral_play_m"] = norms(off - (off @ ahead)[:, None] * ahead).max()
    measured = low_passed(t, force)[0][first:last + 1] @ left
    ideal = (v[first:last + 1] @ ahead) * (left @ np.array(reach["field_n_s_per_m"]) @ ahead)
    out["adaptation_index"] = (measured * ideal).sum() / (ideal * ideal).sum()
    out["adaptation_r"] = np.corrcoef(measured, ideal)[0, 1]


def add_assessment(out, t, x, force, reach):  # the trial begins with the cue
    start, target = np.array(reach["start_m"]), np.array(reach["target_m"])
    distance = np.sqrt(((target - start) ** 2).sum())
    ahead = (target - start) / distance
    place, t = (x - start) @ ahead, t - t[0]
    if reach["goal"] == "range":
        hold = reach["hold_s"]
        kept = [place[(t >= at) & (t <= at + hold)].min() for at in t if at + hold <= t[-1]]
        out["range_m"] = max(kept)
    elif reach["goal"] == "press":
        f = -force @ ahead
        integral = np.r_[0, np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(t))]
        begins = t[t <= t[-1] - 0.5]
        out["press_force_n"] = ((np.interp(begins + 0.5, t, integral) - np.interp(begins, t, integral)) / 0.5).max()
    elif reach["goal"] == "weigh":
        f = -force @ ahead
        whole = t >= t[-1] - 3 - 1e-9
        out["arm_weight_n"] = np.trapz(f[whole], t[whole]) / np.ptp(t[whole])
    else:
        track = reach["track"]
        w, phase = 2 * np.pi * np.array(track["frequencies_hz"]), np.array(track["phases_rad"])
        counted = t >= track["discard_s"]
        late = lambda tau: np.sin(np.outer(t[counted] - tau, w) + phase) * distance / len(w)
        error = x[counted] - start - np.outer(late(0).sum(axis=1), ahead)
        out["tracking_rms_m"] = np.sqrt((error ** 2).sum(axis=1).mean())
        angles = np.outer(t[counted], w)
        model = np.column_stack([np.ones(counted.sum()), np.sin(angles), np.cos(angles)])
        fit = np.linalg.lstsq(model, place[counted], rcond=None)[0]
        size = distance / len(w)
        # What is left of the hand's sines after the best copy of the target's.
        taus = np.arange(-0.5, 1.5, 0.0005)
        gain = [(fit[1:1 + len(w)] * np.cos(phase - w * tau) + fit[1 + len(w):] * np.sin(phase - w * tau)).mean() / size
                for tau in taus]
        out["tracking_gain"], out["tracking_delay_s"] = max(gain), taus[np.argmax(gain)]


def add_path(out, t, x, force, samples):
    reference = samples["reference_position"]
    guided = "progress" in samples
    rows = np.arange(len(t))
    if guided:
        farthest = np.maximum.accumulate(np.r_[-1, samples["progress"][:-1]])
        rows = np.nonzero(samples["progress"] > farthest)[0]
    curve = Curve(reference[rows])
    arc, s = np.empty(len(t)), 0.0
    for i, p in enumerate(x):
        arc[i] = s = curve.foot(p, s - 0.01, s + 0.02)
    distance = norms(x - curve.at(arc))
    covered = arc.max() - arc.min()
    out["contour_rms_m"] = np.sqrt(time_mean(t, distance ** 2))
    out["contour_peak_m"] = distance.max()
    left = curve.length - arc.max()
    out["completion"] = min(1, (covered + (left if left <= 2e-3 else 0)) / curve.length)
    out["shape_distance_m"] = shape_distance(curve, x)
    if not guided:
        late = norms(x - reference)
        out["deviation_rms_m"] = np.sqrt(time_mean(t, late ** 2))
        out["deviation_peak_m"] = late.max()
        return covered
    inside = distance[:-1] <= samples["tunnel_radius"][:-1]
    out["time_in_tunnel"] = (np.diff(t) * inside).sum() / np.diff(t).sum()
    counted = inside & (t[:-1] - t[0] >= 0.5)
    chord = curve.at(arc + 1e-3) - curve.at(arc - 1e-3)
    push = ((force - samples["reference_force"]) * chord).sum(axis=1) / norms(chord)
    out["helped_time"] = (np.diff(t) * (counted & (push[:-1] > 0.1))).sum() / (np.diff(t) * counted).sum()
    expert = samples["reference_force"][rows]
    at = np.r_[0, np.cumsum(norms(np.diff(reference[rows], axis=0)))]
    difference = by_arc_length(arc, force, curve.length) - by_arc_length(at, expert, curve.length)
    out["force_error_rms_n"] = np.sqrt(np.nanmean((difference ** 2).sum(axis=1)))
    return covered


def main():
    with h5py.File(sys.argv[1], "r") as file:
        run = file["samples/phase"][...] == 2
        samples = {name: column[...][run] for name, column in file["samples"].items()}
    printed = json.load(open(sys.argv[2]))
    t, x, force = samples["time"], samples["position"], samples["force"]
    out = {}
    reach = printed.get("reach")
    if reach:
        (add_assessment if "goal" in reach else add_reach)(out, t, x, force, reach)
    if printed.get("sense"):
        pair, axis = printed["sense"], np.array(printed["sense"]["axis"])
        places = [(x[(t - t[0] >= a) & (t - t[0] <= b)] @ axis).mean() for a, b in (pair["first_s"], pair["second_s"])]
        out["sense_difference_m"] = places[1] - places[0]
    covered = add_path(out, t, x, force, samples) if "reference_position" in samples else None
    if reach and reach.get("goal") in ("press", "weigh"):  # the hand does not move
        out["peak_force_n"] = norms(force).max()
    else:
        add_movement(out, t, x, force, printed["plant"], covered)
    for name, value in printed["figures"].items():
        if value is None:
            if name in out:
                print(name, "is undefined, and numpy has", out[name])
        elif name not in out:
            print(name, "is", value, "and was not recomputed")
        elif abs(value - out[name]) > 0.01 * abs(out[name]) + 1e-7:
            print(name, "is", value, "and numpy has", out[name])


main()
