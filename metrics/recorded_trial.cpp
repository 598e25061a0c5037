#include "metrics/recorded_trial.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/suggest.h"
#include "control/path/arc_path.h"
#include "control/path/path_change.h"
#include "control/path/path_smoothing.h"
#include "formats/documents/reach_task.h"
#include "formats/recording/recording_summary.h"
#include "metrics/path_alignment.h"
#include "metrics/time_warping.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr std::array<std::string_view, 11> kTrialColumns{
    "time",          "position", "force", "force_measured", "reference_position", "reference_force", "progress",
    "tunnel_radius", "phase",    "tick",  "support"};

TrialKind kind_of(const RecordingHeader& header, const RecordingColumns& columns) {
  if (header.config.is_object() && header.config.contains("reach")) return TrialKind::reach;
  if (!columns.reference) return TrialKind::free;
  if (!columns.guidance) return TrialKind::passive;
  return text_in(header.config, "mode", "tunnel") == "cursor" ? TrialKind::cursor : TrialKind::guided;
}

/// Builds the curve through `points`, at least one of which is finite, with the forces there. An expert's forces may be
/// missing or zero.
TrialPath path_through(std::span<const Vec3> points, std::span<const Vec3> forces) {
  constexpr double kTolerance = 1e-6;  // [m], below the resolution of every device
  const Polyline all(points);
  TrialPath path{.curve = all.simplified(kTolerance)};
  const bool any = std::any_of(forces.begin(), forces.end(), [](const Vec3& f) { return f.squaredNorm() > 0; });
  if (!any || !(path.curve.length() > 0)) return path;
  std::vector<double> arc;
  double length = 0;
  Vec3 before = nan3();
  for (const Vec3& point : points) {
    if (point.allFinite()) {
      if (before.allFinite()) length += (point - before).norm();
      before = point;
    }
    arc.push_back(point.allFinite() ? length : kNaN);
  }
  for (double& at : arc) at *= path.curve.length() / all.length();
  path.expert = force_by_arc_length(arc, forces, path.curve.length(), path.spacing);
  return path;
}

/// Returns the path without steps shorter than `spacing` [m]. The tremor of a resting hand and encoder counts would
/// otherwise make the path longer than any band.
Polyline without_noise(std::span<const Vec3> way, double spacing) {
  std::vector<Vec3> points;
  for (const Vec3& p : way)
    if (p.allFinite() && (points.empty() || (p - points.back()).norm() >= spacing)) points.push_back(p);
  return Polyline(points);
}

bool any_finite(std::span<const Vec3> points) {
  return std::any_of(points.begin(), points.end(), [](const Vec3& p) { return p.allFinite(); });
}

/// Clears the column if none of its rows is finite.
void drop_unknown(std::vector<Vec3>& column) {
  if (!any_finite(column)) column.clear();
}

std::optional<double> rms_of(const std::optional<Deviation>& deviation) {
  return deviation ? std::optional(deviation->rms) : std::nullopt;
}

std::optional<double> peak_of(const std::optional<Deviation>& deviation) {
  return deviation ? std::optional(deviation->peak) : std::nullopt;
}

template <auto Member>
std::optional<double> of_movement(const TrialFigures& figures) {
  if (!figures.movement) return std::nullopt;
  return (*figures.movement).*Member;
}

/// Returns the largest magnitude of the force, as it was sent: a filter would hide what the hand felt.
std::optional<double> peak_of(const std::vector<Vec3>& force) {
  double peak = -1;
  for (const Vec3& f : force)
    if (f.allFinite()) peak = std::max(peak, f.norm());
  return peak < 0 ? std::nullopt : std::optional(peak);
}

/// Returns the share of the time in which the hand was within the recorded radius of its place: the nearest point of
/// the path on its branch, or in a cursor trial, and without a path, the reference of the session.
std::optional<double> time_in_tunnel(const RecordedTrial& trial, const std::optional<TrialPath>& path,
                                     const std::vector<double>& arc) {
  const bool aligned = !arc.empty() && trial.kind == TrialKind::guided;
  if (trial.radius.empty() || (!aligned && trial.reference.empty())) return std::nullopt;
  double inside = 0, known = 0;
  for (std::size_t i = 0; i + 1 < trial.time.size(); ++i) {
    const Vec3 place = aligned ? path->curve.at(arc[i]) : trial.reference[i];
    const double distance = (trial.position[i] - place).norm();
    if (!std::isfinite(distance) || !std::isfinite(trial.radius[i])) continue;
    const double step = trial.time[i + 1] - trial.time[i];
    known += step;
    if (distance <= trial.radius[i]) inside += step;
  }
  return known > 0 ? std::optional(inside / known) : std::nullopt;
}

template <auto Member>
std::optional<double> of_reach(const TrialFigures& figures) {
  if (!figures.reach) return std::nullopt;
  return (*figures.reach).*Member;
}

/// Returns the lateral deviation of a reach of this kind.
template <ReachKind kind>
std::optional<double> deviation_of_reach(const TrialFigures& figures) {
  if (!figures.reach || figures.reach_kind != kind) return std::nullopt;
  return figures.reach->lateral_deviation;
}

template <auto Member>
std::optional<double> of_force(const TrialFigures& figures) {
  if (!figures.movement || !figures.movement->force) return std::nullopt;
  return (*figures.movement->force).*Member;
}

// Shared parts of the definitions, as readers see them.
constexpr const char* kLowPass =
    "low-pass filter at 10 Hz without lag (second-order Butterworth, forwards and backwards, at 1 kHz)";
constexpr const char* kUnfiltered = "none (samples as recorded)";
constexpr const char* kThinned = "none (points of the hand's path at least 1 mm apart)";

constexpr TrialFigure kFigures[] = {
    {"contour_rms_m", "rms deviation from the path", "mm", 1e3, 2, -1,
     [](const TrialFigures& f) { return rms_of(f.contour); },
     "Root mean square over time of the distance from the nearest point of the path, on the branch that the hand "
     "followed "
     "in the whole repetition. A delay does not count.",
     kUnfiltered},
    {"contour_peak_m", "largest deviation from the path", "mm", 1e3, 2, -1,
     [](const TrialFigures& f) { return peak_of(f.contour); },
     "Largest distance from the nearest point of the path, on that branch.", kUnfiltered},
    {"deviation_rms_m", "rms deviation at the same instant", "mm", 1e3, 2, -1,
     [](const TrialFigures& f) { return rms_of(f.deviation); },
     "Root mean square over time of the distance from the point of the path at the same instant. Defined for "
     "repetitions in which the path sets the time.",
     kUnfiltered},
    {"deviation_peak_m", "largest deviation at the same instant", "mm", 1e3, 2, -1,
     [](const TrialFigures& f) { return peak_of(f.deviation); },
     "Largest distance from the point of the path at the same instant.", kUnfiltered},
    {"time_in_tunnel", "time in the tunnel", "%", 1e2, 0, 1, [](const TrialFigures& f) { return f.time_in_tunnel; },
     "Share of the time in which the hand was within the tunnel's radius of its nearest point on the path. In the mode "
     "cursor, the radius is around the cursor, so a delay counts.",
     kUnfiltered},
    {"helped_time", "time with help", "%", 1e2, 0, 0, [](const TrialFigures& f) { return f.helped; },
     "Share of the time in the tunnel in which the device pushed the hand along the path with more than 0.1 N beyond "
     "the expert's force. The first 0.5 s, in which the force of the approach fades, do not count.",
     kUnfiltered},
    {"completion", "path completed", "%", 1e2, 0, 1, [](const TrialFigures& f) { return f.completion; },
     "Share of the path's length that the hand passed, each part once. Parts that the hand left out do not count; "
     "corners that it cut do, and so do the last 2 mm, at which a repetition ends. For a reach: the largest share of "
     "the distance to the target that the hand came.",
     kUnfiltered},
    {"shape_distance_m", "shape distance", "mm", 1e3, 2, -1, [](const TrialFigures& f) { return f.shape_distance; },
     "Mean distance between the hand's path and the whole path along their best alignment, independent of speed "
     "(dynamic time warping, Sakoe and Chiba 1978). Defined for repetitions that reached the end of the path.",
     kThinned},
    {"movement_time_s", "movement time", "s", 1, 2, -1, of_movement<&MovementFigures::movement_time>,
     "Time from the instant at which the speed first reaches 5 % of its peak to the instant at which it last falls "
     "below.",
     kLowPass},
    {"dwell_time_s", "time at rest", "s", 1, 2, -1, of_movement<&MovementFigures::dwell_time>,
     "Part of the movement time in which the hand was slower than 5 % of its peak speed.", kLowPass},
    {"path_length_m", "path length of the hand", "mm", 1e3, 0, 0, of_movement<&MovementFigures::path_length>,
     "Length of the hand's path in the movement time.", kLowPass},
    {"normalised_length", "normalised path length", "", 1, 3, -1,
     [](const TrialFigures& f) { return f.movement ? f.movement->normalised_length : std::nullopt; },
     "Length of the hand's path divided by the length of the path that it covered; 1 is exactly along the path. "
     "Undefined when the covered length is less than 5 % of the path or less than 2 mm, because a resting hand "
     "trembles.",
     kLowPass},
    {"mean_speed_m_per_s", "mean speed", "mm/s", 1e3, 0, 0, of_movement<&MovementFigures::mean_speed>,
     "Length of the hand's path divided by the movement time.", kLowPass},
    {"peak_speed_m_per_s", "peak speed", "mm/s", 1e3, 0, 0, of_movement<&MovementFigures::peak_speed>,
     "Largest speed of the hand.", kLowPass},
    {"speed_peaks", "speed peaks", "", 1, 0, -1, of_movement<&MovementFigures::speed_peaks>,
     "Number of maxima of the speed that rise above their surroundings by 5 % of the largest speed; 1 is a single "
     "stroke.",
     kLowPass},
    {"sparc", "smoothness (SPARC)", "", 1, 2, 1,
     [](const TrialFigures& f) { return f.movement ? f.movement->sparc : std::nullopt; },
     "Spectral arc length of the speed from onset to end, up to 10 Hz, where the spectrum exceeds 5 % of its maximum, "
     "padded 16 times (Balasubramanian and others 2015): -1.4 for the smoothest reach, more negative for less smooth "
     "movements. It hardly depends on amplitude or duration.",
     kLowPass},
    {"log_jerk", "smoothness (log jerk)", "", 1, 2, 1,
     [](const TrialFigures& f) { return f.movement ? f.movement->log_jerk : std::nullopt; },
     "Negative logarithm of the dimensionless jerk, from the second difference of the speed (speed form, Hogan and "
     "Sternad 2009), from onset to end: -4.4 for the smoothest reach under this rule, -5.3 if it is not cropped; more "
     "negative for less smooth movements. It depends on duration: compare equal tasks under one rule only.",
     kLowPass},
    {"log_jerk_vector", "smoothness (log jerk, vector)", "", 1, 2, 1,
     [](const TrialFigures& f) { return f.movement ? f.movement->log_jerk_vector : std::nullopt; },
     "The same from the second difference of the velocity as a vector (vector form, Balasubramanian and others 2015). "
     "On a straight line both forms are equal. Turning counts as jerk in this form only.",
     kLowPass},
    {"force_error_rms_n", "rms difference from the expert's force", "N", 1, 2, -1,
     [](const TrialFigures& f) { return f.force_error ? std::optional(f.force_error->error.rms) : std::nullopt; },
     "Root mean square along the path of the difference between the felt force and the expert's force at the same "
     "point. Defined where the expert's force was replayed and the hand covered enough of the path.",
     kUnfiltered},
    {"mean_force_n", "mean force of the device", "N", 1, 2, 0, of_force<&ForceFigures::mean>,
     "Mean magnitude of the device's force on the hand. The force that leads the hand to the start fades within the "
     "first 0.3 s of a repetition and counts, even if no other force is sent (free).",
     kLowPass},
    {"peak_force_n", "peak force of the device", "N", 1, 2, 0, [](const TrialFigures& f) { return f.peak_force; },
     "Largest magnitude of the device's force on the hand in the whole repetition, as it was sent.", kUnfiltered},
    {"mean_force_across_n", "mean force across the movement", "N", 1, 2, 0, of_force<&ForceFigures::mean_across>,
     "Mean magnitude of the component of that force that is perpendicular to the movement.", kLowPass},
    {"assist_work_j", "work of the device on the hand", "mJ", 1e3, 1, 0, of_force<&ForceFigures::assist>,
     "Work of the device on the hand while its force acted along the movement.", kLowPass},
    {"resist_work_j", "work of the hand on the device", "mJ", 1e3, 1, 0, of_force<&ForceFigures::resist>,
     "Work that the device took from the hand while its force acted against the movement.", kLowPass},
    {"person_work_estimate_j", "work of the participant, estimated", "mJ", 1e3, 1, 0,
     [](const TrialFigures& f) { return f.movement ? f.movement->person_work_estimate : std::nullopt; },
     "Work of the participant on the device: the change of its kinetic energy plus the friction losses, less the work "
     "of weight and motors. The estimate is as good as the device's calibration and does not include a hand that "
     "pushes against a wall.",
     kLowPass},
    {"reaction_time_s", "reaction time", "ms", 1e3, 0, -1, of_reach<&ReachFigures::reaction_time>,
     "Time from the cue to the start of a reach. The start is the zero of a minimum-jerk movement that is fitted to "
     "the "
     "speed between 10 and 60 % of its first maximum (a back-fit after Botzer and Karniel 2009). Undefined below 0.1 s "
     "and above 1 s. It includes the delay of picture and sound.",
     kLowPass},
    {"initial_direction_error_rad", "initial direction error", "degrees", 180 / std::numbers::pi, 1, 0,
     of_reach<&ReachFigures::initial_direction_error>,
     "Angle from the direction of the target to the direction from the hand's place at the onset to its place at the "
     "first maximum of the speed; positive to the left.",
     kLowPass},
    {"path_ratio", "path length ratio", "", 1, 2, -1, of_reach<&ReachFigures::path_ratio>,
     "Length of the hand's path from onset to end over the distance from start to target.", kLowPass},
    {"lateral_deviation_m", "lateral deviation at peak speed", "mm", 1e3, 1, 0, deviation_of_reach<ReachKind::plain>,
     "Signed distance from the line through start and target at the largest speed of a reach; positive to the left. "
     "Undefined in catch trials and clamps.",
     kLowPass},
    {"after_effect_m", "after-effect", "mm", 1e3, 1, 0, deviation_of_reach<ReachKind::catch_trial>,
     "The same in a catch trial, in which the force field is off without a warning. Its sign is opposite to that of a "
     "deviation that the field causes, in a hand that has learned the field.",
     kLowPass},
    {"field_share", "share of the force field", "%", 1e2, 0, 0, of_reach<&ReachFigures::field_share>,
     "Share of the force field that acted: sum(F . B v) / sum |B v|^2 from onset to end, with the sent force F. Limits "
     "of "
     "force and energy, and the guard, lower it. Below 90 %, a reach does not count in the means of its block.",
     kLowPass},
    {"end_error_m", "end error", "mm", 1e3, 1, -1, of_reach<&ReachFigures::end_error>,
     "Distance of the hand from the target's centre at the end of the reach.", kLowPass},
    {"adaptation_index", "adaptation index", "", 1, 2, 0, of_reach<&ReachFigures::adaptation_index>,
     "Of an error clamp: sum(F_m F_i) / sum(F_i^2) from onset to end. F_m is the lateral force of the channel, "
     "measured "
     "if the recording has it, else as sent; F_i is the lateral force of the field at the speed along the reach. 1: "
     "the "
     "hand compensates for the whole field. A channel of k N/m shows k / (k + K) of this on an arm of K N/m. Undefined "
     "if the lateral play is above 3 mm, and if the channel broke, vibrated or was limited.",
     kLowPass},
    {"adaptation_r", "correlation of the clamp's force", "", 1, 2, 0, of_reach<&ReachFigures::adaptation_r>,
     "Pearson correlation of F_m and F_i of the adaptation index.", kLowPass},
    {"lateral_play_m", "lateral play of a clamp", "mm", 1e3, 1, -1,
     [](const TrialFigures& f) {
       return f.reach && f.reach_kind == ReachKind::clamp ? std::optional(f.reach->lateral_play) : std::nullopt;
     },
     "Largest distance from the line through start and target in an error clamp, from onset to end.", kLowPass},
    {"range_m", "range of motion", "mm", 1e3, 1, 1,
     [](const TrialFigures& f) { return f.range ? std::optional(f.range->distance) : std::nullopt; },
     "Largest distance from the start, along the direction of the trial, that the hand kept for the hold (usually 0.5 "
     "s). "
     "At the end of the workspace it is a lower bound.",
     kUnfiltered, true},
    {"press_force_n", "maximum force", "N", 1, 2, 1,
     [](const TrialFigures& f) {
       return f.press && f.press->refused.empty() ? std::optional(f.press->force) : std::nullopt;
     },
     "Largest mean over 0.5 s of the force of the hand along the direction of the trial: measured if the device has a "
     "force sensor, else as the device sent it to hold the hand. It is a lower bound if the device had no more force, "
     "or gave way.",
     kUnfiltered, true},
    {"arm_weight_n", "weight of the arm", "N", 1, 2, 0,
     [](const TrialFigures& f) {
       return f.weigh && f.weigh->refused.empty() ? std::optional(f.weigh->weight) : std::nullopt;
     },
     "Mean over the last 3 s of the force with which an arm that rests on the device presses straight down: measured "
     "if "
     "the device has a force sensor, else as the device sent it to hold the hand. It is a lower bound if the device "
     "had "
     "no more force, or gave way. It is the part of the arm's weight that lies on the handle.",
     kUnfiltered, true},
    {"sense_difference_m", "difference of the places", "mm", 1e3, 1, 0,
     [](const TrialFigures& f) { return f.difference; },
     "Of a pair of places to which the device moved the hand: distance of the second one less the first one, from the "
     "mean positions in the second halves of the stays.",
     kUnfiltered},
    {"tracking_rms_m", "rms error of tracking", "mm", 1e3, 2, -1,
     [](const TrialFigures& f) { return f.track ? std::optional(f.track->rms) : std::nullopt; },
     "Root mean square over time of the distance from the moving target, without the first seconds (usually 5).",
     kUnfiltered},
    {"tracking_gain", "gain of tracking", "", 1, 2, 0,
     [](const TrialFigures& f) { return f.track ? f.track->gain : std::nullopt; },
     "Gain of the hand at the frequencies of the target, at the delay that fits best (least squares); 1: it moves as "
     "far as the target.",
     kUnfiltered},
    {"tracking_delay_s", "delay of tracking", "ms", 1e3, 0, -1,
     [](const TrialFigures& f) { return f.track ? f.track->delay : std::nullopt; },
     "Delay with which a copy of the target's movement is nearest to the hand's at these frequencies. Undefined for a "
     "gain below 0.1. It includes the delay of the picture.",
     kUnfiltered},
};

}  // namespace

namespace {

/// Returns why the channel of a clamp did not act as planned during a trial; empty if it did.
std::string spoiled_by(const std::vector<StoredEvent>& events, const RecordedTrial& trial) {
  if (trial.time.empty()) return "";
  for (const StoredEvent& event : events) {
    if (event.time < trial.time.front() || event.time > trial.time.back()) continue;
    switch (static_cast<EventCode>(event.code)) {
      case EventCode::deviation_over:
        return "the hand broke out of the channel";
      case EventCode::oscillation:
      case EventCode::vibrates:
      case EventCode::vibrates_regularly:
      case EventCode::bounces:
        return "the channel vibrated and was softened";
      case EventCode::force_limit:
      case EventCode::continuous_limit:
        return "the force of the channel was limited";
      default:
        break;
    }
  }
  return "";
}

/// Returns what all repetitions of a recording have in common.
RecordedTrial common_part(const RecordingHeader& header, const RecordingColumns& columns, const std::string& file) {
  const nlohmann::json& config = header.config;
  RecordedTrial trial{.kind = kind_of(header, columns), .force_scale = number_in(config, "force-scale").value_or(1)};
  // Without guidance there is no expert's force to feel, and none is missing.
  if (text_in(config, "mode") == "free") trial.force_scale = 0;
  if (text_in(config, "feel", "active") == "resist") trial.force_scale = -trial.force_scale;
  if (trial.kind == TrialKind::reach) trial.reach = reach_trial_from(JsonReader(config["reach"], file + ": reach"));
  if (config.is_object() && config.contains("sense"))
    trial.sense = sense_pair_from(JsonReader(config["sense"], file + ": sense"));
  return trial;
}

/// Adds a sample to a repetition. Throws Error(input) if it has too many.
void add_sample(const Sample& sample, const RecordingColumns& columns, const std::string& file, RecordedTrial& trial) {
  if (trial.time.size() >= kLongestTrial)
    throw input_error(
        fmt::format("{}: repetition {} has more than {} million samples, the limit of a report; cut out a part of "
                    "it: haptrace convert {} --from 0 --to 3600 -o part.h5",
                    file, trial.repetition, kLongestTrial / 1'000'000, file));
  trial.time.push_back(1e-9 * static_cast<double>(sample.time_ns));
  trial.position.push_back(sample.position);
  trial.force.push_back(sample.force);
  if (columns.force_measured) trial.measured.push_back(sample.force_measured);
  if (columns.reference) trial.reference.push_back(sample.reference_position);
  if (columns.guidance) {
    trial.expert.push_back(sample.reference_force);
    trial.progress.push_back(sample.progress);
  }
  if (columns.tunnel) trial.radius.push_back(sample.tunnel_radius);
  if (columns.support) trial.support.push_back(sample.support.allFinite() ? sample.support : Vec3(Vec3::Zero()));
}

}  // namespace

std::vector<RecordedTrial> read_trials(const RecordingReader& reader, const std::string& file) {
  const RecordingColumns columns = reader.columns();
  std::uint64_t runs = 0;
  for (const RecordingSummary& block : reader.overview()) runs += block.run_rows;
  const RecordingHeader header = reader.header();
  const RecordedTrial common = common_part(header, columns, file);
  const std::optional<ReachTrial>& reach = common.reach;

  std::vector<RecordedTrial> trials;
  // A reach whose cue never came has no rows.
  if (reach && runs == 0) trials.push_back({.kind = TrialKind::reach, .reach = reach});
  bool in_trial = false;
  constexpr std::uint64_t kRowsAtOnce = 65'536;
  for (std::uint64_t row = 0; row < reader.rows(); row += kRowsAtOnce)
    for (const Sample& sample : reader.read(row, kRowsAtOnce, kTrialColumns)) {
      if ((runs > 0 || reach) && sample.phase != Phase::run) {
        in_trial = false;
        continue;
      }
      if (!in_trial) {
        trials.push_back(common);
        trials.back().repetition = static_cast<int>(trials.size());
        in_trial = true;
      }
      add_sample(sample, columns, file, trials.back());
    }
  if (reach &&
      (reach->kind == ReachKind::clamp || reach->goal == ReachGoal::press || reach->goal == ReachGoal::weigh)) {
    const std::vector<StoredEvent> events = reader.events();
    for (RecordedTrial& trial : trials) trial.spoiled = spoiled_by(events, trial);
  }
  for (RecordedTrial& trial : trials)
    for (std::vector<Vec3>* column : {&trial.force, &trial.measured, &trial.reference, &trial.expert})
      drop_unknown(*column);
  return trials;
}

namespace {

/// Returns forces, if there are any, less the part of them that carried the arm.
std::vector<Vec3> without(std::vector<Vec3> forces, std::span<const Vec3> support) {
  for (std::size_t i = 0; i < std::min(forces.size(), support.size()); ++i) forces[i] -= support[i];
  return forces;
}

/// Returns the share of the time in the tunnel in which the device helped along the path; nothing without such time.
std::optional<double> helped_share(const RecordedTrial& trial, const Polyline& curve, const std::vector<double>& arc) {
  if (trial.force.empty() || trial.radius.empty()) return std::nullopt;
  constexpr double kFading = 0.5, kHelp = 0.1, kChord = 1e-3;  // [s], [N], [m]
  const std::vector<Vec3> unsupported = without(trial.force, trial.support);
  double helped = 0, known = 0;
  for (std::size_t i = 0; i + 1 < trial.time.size(); ++i) {
    const double distance = (trial.position[i] - curve.at(arc[i])).norm();
    if (trial.time[i] - trial.time.front() < kFading || !(distance <= trial.radius[i]) || !std::isfinite(arc[i]))
      continue;
    Vec3 force = unsupported[i];
    if (!trial.expert.empty() && trial.expert[i].allFinite()) force -= trial.force_scale * trial.expert[i];
    const Vec3 tangent = (curve.at(arc[i] + kChord) - curve.at(arc[i] - kChord)).normalized();
    const double step = trial.time[i + 1] - trial.time[i];
    known += step;
    if (force.dot(tangent) > kHelp) helped += step;
  }
  return known > 0 ? std::optional(helped / known) : std::nullopt;
}

}  // namespace

TrialPath path_of(const Path& path) {
  return path_through(smooth_positions(path, smoothing_time({&path, 1})), path.force);
}

std::optional<TrialPath> path_of(const RecordedTrial& trial) {
  if (!any_finite(trial.reference)) return std::nullopt;
  TrialPath path = [&] {
    if (trial.progress.empty()) return path_through(trial.reference, {});
    // The reference of a guided trial stands still and may go back. Keeps every point once.
    std::vector<Vec3> points, forces;
    double farthest = -1;
    for (std::size_t i = 0; i < trial.reference.size(); ++i) {
      if (!(trial.progress[i] > farthest) || !trial.reference[i].allFinite()) continue;
      farthest = trial.progress[i];
      points.push_back(trial.reference[i]);
      if (!trial.expert.empty()) forces.push_back(trial.expert[i]);
    }
    return points.empty() ? path_through(trial.reference, {}) : path_through(points, forces);
  }();
  path.whole = false;
  return path;
}

namespace {

/// Computes the metrics of shape and force along the path, of a trial that was aligned with it.
void add_path_figures(TrialFigures& figures, const RecordedTrial& trial, const TrialPath& path,
                      const PathAlignment& alignment, bool walks) {
  const double length = path.curve.length();
  constexpr double kCame = 0.95, kPoints = 2000, kLongestWay = 10;
  if (walks && path.whole && alignment.farthest >= kCame * length) {
    WarpingOptions warping{.spacing = std::max(1e-3, length / kPoints)};
    const Polyline hand = without_noise(trial.position, warping.spacing);
    warping.band = std::max(warping.band, 1.1 * std::abs(hand.length() - length));
    if (hand.length() <= kLongestWay * length) figures.shape_distance = warping_distance(path.curve, hand, warping);
  }
  // In other kinds of trials the hand does not feel the expert's force.
  const bool guided = trial.kind == TrialKind::guided || trial.kind == TrialKind::cursor;
  if (walks && guided && trial.force_scale != 0 && !path.expert.empty() && !trial.force.empty()) {
    std::vector<Vec3> expert = path.expert;
    for (Vec3& force : expert) force *= trial.force_scale;
    figures.force_error = force_deviation(
        force_by_arc_length(alignment.arc, without(trial.force, trial.support), length, path.spacing, alignment.jumps),
        expert);
  }
}

}  // namespace

namespace {

/// Returns the share of the distance to the target that the hand came; nothing without positions.
std::optional<double> completion_of_reach(const ReachGeometry& geometry, std::span<const Vec3> positions) {
  std::optional<double> farthest;
  for (const Vec3& p : positions)
    if (p.allFinite())
      farthest = std::max(farthest.value_or(0), (p - geometry.start).dot(geometry.along()) / geometry.distance());
  if (positions.empty()) return 0;  // the reach did not begin
  return farthest ? std::optional(std::min(1.0, *farthest)) : std::nullopt;
}

/// Returns the distance of the second place of a pair less the first one, as the hand was moved: means over the second
/// halves of the stays [m]. Nothing if one of them has no positions.
std::optional<double> difference_of(const RecordedTrial& trial, const SensePair& pair) {
  const auto place = [&](const std::array<double, 2>& window) -> std::optional<double> {
    double sum = 0, n = 0;
    for (std::size_t i = 0; i < trial.time.size(); ++i) {
      const double since = trial.time[i] - trial.time.front();
      if (since < window[0] || since > window[1] || !trial.position[i].allFinite()) continue;
      sum += trial.position[i].dot(pair.axis);
      n += 1;
    }
    return n > 0 ? std::optional(sum / n) : std::nullopt;
  };
  const std::optional<double> first = place(pair.first), second = place(pair.second);
  return first && second ? std::optional(*second - *first) : std::nullopt;
}

/// Adds the metrics of a trial with a cue.
void add_reach_figures(TrialFigures& figures, const RecordedTrial& trial, const Trial& samples) {
  const ReachTrial& reach = *trial.reach;
  switch (reach.goal) {
    case ReachGoal::target: {
      const std::vector<Vec3> force = without(trial.force, trial.support),
                              measured = without(trial.measured, trial.support);
      Trial unsupported = samples;
      unsupported.force = force;
      unsupported.measured = measured;
      figures.reach = reach_figures(unsupported, reach, trial.spoiled);
      figures.reach_kind = reach.kind;
      figures.completion = completion_of_reach(reach.geometry, trial.position);
      break;
    }
    case ReachGoal::range:
      figures.range = range_figures(samples, reach);
      break;
    case ReachGoal::press:
      figures.press = press_figures(samples, reach, trial.spoiled);
      break;
    case ReachGoal::track:
      figures.track = track_figures(samples, reach);
      break;
    case ReachGoal::weigh:
      figures.weigh = weigh_figures(samples, reach, trial.spoiled);
      break;
  }
}

}  // namespace

TrialFigures trial_figures(const RecordedTrial& trial, const std::optional<TrialPath>& path,
                           const std::optional<PlantModel>& plant, const PathAlignment* aligned) {
  TrialFigures figures{.duration = trial.time.empty() ? 0 : trial.time.back() - trial.time.front(),
                       .samples = trial.time.size()};
  MovementOptions movement{.plant = plant};
  PathAlignment own;
  const Trial samples{.time = trial.time, .position = trial.position, .force = trial.force, .measured = trial.measured};
  if (trial.reach) {
    add_reach_figures(figures, trial, samples);
  } else if (path && path->curve.length() > 0) {
    if (aligned == nullptr) own = align_with_path(path->curve, trial.position);
    const PathAlignment& alignment = aligned != nullptr ? *aligned : own;
    const double length = path->curve.length();
    // A repetition ends as soon as the hand arrives: what is left then is not left out.
    const double left = is_at_end(alignment.farthest, length) ? length - alignment.farthest : 0;
    const double passed = alignment.covered + left;
    if (path->whole) figures.completion = std::min(1.0, passed / length);
    figures.contour = contour_deviation(trial.time, trial.position, path->curve, alignment.arc);
    // A resting hand trembles along the path but does not follow it.
    constexpr double kLeastShare = 0.05, kLeastWalk = 2e-3;
    const bool walks = alignment.covered >= std::max(kLeastWalk, kLeastShare * length);
    if (walks) movement.reference_length = alignment.covered;
    add_path_figures(figures, trial, *path, alignment, walks);
    if (trial.kind == TrialKind::guided) figures.helped = helped_share(trial, path->curve, alignment.arc);
    figures.time_in_tunnel = time_in_tunnel(trial, path, alignment.arc);
  } else {
    figures.time_in_tunnel = time_in_tunnel(trial, path, {});
  }
  if (trial.kind == TrialKind::passive || trial.kind == TrialKind::cursor)
    figures.deviation = deviation(trial.time, trial.position, trial.reference);
  if (trial.sense) figures.difference = difference_of(trial, *trial.sense);
  if (figures.difference) {
    const double off = std::abs(*figures.difference - trial.sense->difference);
    if (off > std::max(SensePair::kLargestError, 0.5 * std::abs(trial.sense->difference)))
      figures.refused_pair =
          fmt::format("the places differed by {:.1f} mm instead of {:.1f} mm: the hand did not let the device lead it",
                      1e3 * std::abs(*figures.difference), 1e3 * std::abs(trial.sense->difference));
  }
  figures.peak_force = peak_of(trial.force);
  const bool held = trial.reach && (trial.reach->goal == ReachGoal::press || trial.reach->goal == ReachGoal::weigh);
  if (!held) figures.movement = movement_figures(samples, movement);
  return figures;
}

std::span<const TrialFigure> all_trial_figures() {
  return kFigures;
}

const TrialFigure& trial_figure(std::string_view name) {
  const auto found = std::find_if(std::begin(kFigures), std::end(kFigures),
                                  [&](const TrialFigure& figure) { return name == figure.name; });
  if (found != std::end(kFigures)) return *found;
  std::vector<std::string> known;
  for (const TrialFigure& figure : kFigures) known.emplace_back(figure.name);
  throw input_error(fmt::format("there is no metric '{}'{}", name, suggestion(name, known)));
}

nlohmann::json to_json(const TrialFigures& figures) {
  nlohmann::json json{
      {"definitions", kFigureDefinitions}, {"duration_s", figures.duration}, {"samples", figures.samples}};
  for (const TrialFigure& figure : kFigures) {
    json[figure.name] = json_of_number(figure.value(figures));
  }
  const std::string refused = figures.reach   ? figures.reach->refused
                              : figures.press ? figures.press->refused
                              : figures.weigh ? figures.weigh->refused
                                              : figures.refused_pair;
  if (!refused.empty()) json["refused"] = refused;
  if (figures.range && figures.range->at_limit)
    json["at_limit"] = "the hand was at the end of the workspace: the person may come farther";
  if (figures.press && figures.press->at_limit && figures.press->refused.empty())
    json["at_limit"] = "the device had no more force, or gave way: the person may be stronger";
  if (figures.weigh && figures.weigh->at_limit && figures.weigh->refused.empty())
    json["at_limit"] = "the device had no more force, or gave way: the arm may be heavier";
  return json;
}

nlohmann::json definitions_of_figures() {
  nlohmann::json metrics = nlohmann::json::object();
  for (const TrialFigure& figure : kFigures)
    metrics[figure.name] = {{"title", figure.title},
                            {"meaning", figure.meaning},
                            {"filter", figure.filter},
                            {"better", figure.better < 0   ? "less"
                                       : figure.better > 0 ? "more"
                                                           : "neither"}};
  return {{"version", kFigureDefinitions},
          {"onset_and_end", kOnsetAndEnd},
          {"low_pass", kLowPass},
          {"alignment", kAlignment},
          {"metrics", std::move(metrics)}};
}

std::optional<double> figure_in(const nlohmann::json& figures, std::string_view name) {
  if (!figures.is_object()) return std::nullopt;
  const auto found = figures.find(name);
  return found != figures.end() && found->is_number() ? std::optional(found->get<double>()) : std::nullopt;
}

}  // namespace haptrace
