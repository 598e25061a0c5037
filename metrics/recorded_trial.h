// Trials of a recording and their metrics, for programmes and reports.
#pragma once

#include "control/path/path.h"
#include "formats/documents/sense_task.h"
#include "formats/recording/recording.h"
#include "metrics/assessment.h"
#include "metrics/deviation.h"
#include "metrics/movement.h"
#include "metrics/path_alignment.h"
#include "metrics/reaching.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// The kind of guidance of a trial.
enum class TrialKind {
  passive,  ///< the device moves the hand along a path; the reference has its own time
  cursor,   ///< the trainee follows a cursor that moves in its own time
  guided,   ///< the trainee follows a path in their own time, with or without a tunnel
  free,     ///< no path
  reach,    ///< a trial with a cue, with which it begins: ReachGoal
};

/// One section in the phase run, or a whole recording without such sections. Columns have the length of `time`, or are
/// empty if the recording does not have them.
struct RecordedTrial {
  TrialKind kind = TrialKind::free;
  int repetition = 1;            ///< within its recording, counted from 1
  std::vector<double> time;      ///< since the first row of the recording [s]
  std::vector<Vec3> position;    ///< p_WT [m]
  std::vector<Vec3> force;       ///< force of the device on the hand, as sent [N]
  std::vector<Vec3> measured;    ///< the same force, measured by a sensor [N]
  std::vector<Vec3> reference;   ///< reference at the same instant; in a guided trial, the point on the path [m]
  std::vector<Vec3> expert;      ///< expert's force at that point, as recorded [N]
  std::vector<double> progress;  ///< arc length of that point [m]
  std::vector<double> radius;    ///< tunnel radius at that point [m]
  std::vector<Vec3> support;     ///< part of the sent force that carried the arm's weight [N]
  double force_scale = 1;        ///< factor on the expert's force as felt; negative if the trainee had to overcome it
  std::optional<ReachTrial> reach;  ///< its places and field
  std::optional<SensePair> sense;   ///< where it shows the two places of a pair
  std::string spoiled;              ///< why a clamp or a lock did not act as planned; empty otherwise
};

inline constexpr std::uint64_t kLongestTrial = 20'000'000;  ///< largest number of rows read into memory

/// Returns the trials of a recording, in order. Throws Error(input) naming the file when one has more than
/// kLongestTrial rows.
std::vector<RecordedTrial> read_trials(const RecordingReader& reader, const std::string& file);

/// The path of a trial, by arc length.
struct TrialPath {
  Polyline curve;            ///< without points that are within 1 um of the line between others
  std::vector<Vec3> expert;  ///< force_by_arc_length() of the expert's force, as recorded; empty without forces
  double spacing = 1e-3;     ///< length of its cells [m]
  bool whole = true;         ///< false: known only as far as the reference came
};

/// Returns the whole of a path, without the noise of its positions (as in a playback). Throws Error(input) when the
/// path has no finite point.
TrialPath path_of(const Path& path);

/// Returns the path of a trial from its own columns. It reaches only as far as the reference came, so `whole` is false.
/// Returns nothing without a reference.
std::optional<TrialPath> path_of(const RecordedTrial& trial);

/// Metrics of a trial. Undefined metrics are empty.
struct TrialFigures {
  double duration = 0;                   ///< duration of the trial [s]
  std::size_t samples = 0;               ///< rows of the trial
  std::optional<Deviation> deviation;    ///< from the reference at the same instant; passive and cursor trials
  std::optional<Deviation> contour;      ///< from the aligned point of the path, whatever the time
  std::optional<double> time_in_tunnel;  ///< fraction of the time, 0 to 1; in a cursor trial, around the cursor
  std::optional<double> helped;          ///< fraction of the time in the tunnel in which the device pushed the hand
                                         ///< along the path, beyond the expert's force; guided trials
  std::optional<double> completion;      ///< fraction of the path passed, 0 to 1; requires the whole path; of a reach,
                                         ///< largest fraction of the distance to the target
  std::optional<double> shape_distance;  ///< distance between the whole path and the hand's path (dynamic time warping)
                                         ///< [m]; for trials that reached the end with at most ten times its length
  std::optional<ForceDeviation> force_error;  ///< felt force against the expert's, along the path, if it was replayed
  std::optional<double> peak_force;           ///< largest magnitude of the force of all rows, unfiltered [N]
  std::optional<MovementFigures> movement;
  std::optional<ReachFigures> reach;  ///< of a reach to a target, which has no metrics of a path
  std::optional<RangeFigures> range;  ///< of a range of motion
  std::optional<PressFigures> press;  ///< of a press against a lock
  std::optional<TrackFigures> track;  ///< of tracking
  std::optional<WeighFigures> weigh;  ///< of an arm that rests on a lock
  std::optional<double> difference;   ///< of a pair: distance of the second place less the first one [m]
  std::string refused_pair;           ///< why a pair does not count; else empty
  ReachKind reach_kind = ReachKind::plain;
};

/// Computes the metrics of a trial. `plant` is for the estimate of the participant's work. Lengths refer to the part of
/// the path that the hand passed. If that is less than 5 % of the path, or 2 mm, the metrics that compare path lengths,
/// shapes or forces along the path are undefined. `aligned` is align_with_path() of this curve and trial, if the caller
/// has it. A minute at 1 kHz takes about 40 ms of a 2.5 GHz Xeon.
TrialFigures trial_figures(const RecordedTrial& trial, const std::optional<TrialPath>& path,
                           const std::optional<PlantModel>& plant = std::nullopt,
                           const PathAlignment* aligned = nullptr);

/// Version of the definitions of the metrics; to_json() writes it as "definitions". Metrics of different versions must
/// not be compared. 1: the place on the path followed the hand live, and the peak force was low-passed.
inline constexpr int kFigureDefinitions = 2;

/// One metric of a trial, by name.
struct TrialFigure {
  const char* name = "";   ///< with its unit, as in JSON and CSV: contour_rms_m
  const char* title = "";  ///< for users
  const char* unit = "";   ///< shown to users; "" for none
  double scale = 1;        ///< factor from SI to that unit
  int digits = 0;          ///< decimals shown to users
  int better = 0;          ///< -1: less is better; 1: more is; 0: neither
  std::optional<double> (*value)(const TrialFigures& figures) = nullptr;
  const char* meaning = "";  ///< definition and source, for users
  const char* filter = "";   ///< filter of the samples, in words
  bool limited = false;      ///< a device may end before the person does: then the metric is a lower bound
};

/// Returns every metric, in the order of reports.
std::span<const TrialFigure> all_trial_figures();

/// Returns the metric of this name. Throws Error(input) with the nearest name when there is none.
const TrialFigure& trial_figure(std::string_view name);

// Shared parts of the definitions, for users.
inline constexpr const char* kOnsetAndEnd =
    "A movement starts at the instant at which the speed first reaches 5 % of its peak and ends at the instant at "
    "which it last falls below.";
inline constexpr const char* kAlignment =
    "Every position belongs to the nearest point of the path on the branch that the whole repetition followed (dynamic "
    "programming over the length of the path, read back from the end). The live place of the session has no effect.";

/// Returns the definitions of all metrics: their meaning, filter, better direction, the rule of onset and end, and the
/// alignment with the path.
nlohmann::json definitions_of_figures();

/// Returns every metric by its name, null where it is undefined, the number of samples and the version of the
/// definitions. `refused` says why an error clamp has no adaptation index, and `at_limit` why a range or a press may be
/// larger than measured.
nlohmann::json to_json(const TrialFigures& figures);

/// Returns the metric of this name from the output of to_json(); nothing when it is undefined or missing, or when
/// `figures` is not an object.
std::optional<double> figure_in(const nlohmann::json& figures, std::string_view name);

}  // namespace haptrace
