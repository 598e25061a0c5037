// A trial as a recording keeps it, and its figures: what a programme goes by and a report shows.
#pragma once

#include "control/path/path.h"
#include "formats/recording/recording.h"
#include "metrics/deviation.h"
#include "metrics/movement.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// What a session did to who held the device.
enum class TrialKind {
  passive,  ///< moved him along a path: the reference has its own time
  cursor,   ///< had him follow a place that moves in its own time
  guided,   ///< had him move along a path in his own time, in a tunnel or without
  free,     ///< there was no path
};

/// One stretch of phase run; of a recording without any, all of it. Columns have the length of `time`, or are empty
/// where the recording does not have them.
struct RecordedTrial {
  TrialKind kind = TrialKind::free;
  int repetition = 1;            ///< within its recording, from 1
  std::vector<double> time;      ///< since the recording's first row [s]
  std::vector<Vec3> position;    ///< p_WT [m]
  std::vector<Vec3> force;       ///< of the device on the hand, as sent [N]
  std::vector<Vec3> measured;    ///< the same by a sensor [N]
  std::vector<Vec3> reference;   ///< at the same instant; of a guided trial, the place on the path [m]
  std::vector<Vec3> expert;      ///< the expert's force at that place, as recorded [N]
  std::vector<double> progress;  ///< arc length of that place [m]
  std::vector<double> radius;    ///< of the tunnel there [m]
  double force_scale = 1;        ///< of the expert's force as it was felt; negative where it was to be overcome
};

inline constexpr std::uint64_t kLongestTrial = 20'000'000;  ///< rows that are read into memory

/// The trials of a recording, in order. Throws Error(input) naming the file when one has more than kLongestTrial rows.
std::vector<RecordedTrial> read_trials(const RecordingReader& reader, const std::string& file);

/// The path that a trial was about, by arc length.
struct TrialPath {
  Polyline curve;
  std::vector<Vec3> expert;  ///< force_by_arc_length() of the expert's, as recorded; empty without
  double spacing = 1e-3;     ///< of its cells [m]
  bool whole = true;         ///< false: only as far as somebody came, the end is not known
};

/// The whole of a path; the noise of its positions is left aside, as a playback leaves it. Throws Error(input) when it
/// has no finite point.
TrialPath path_of(const Path& path);

/// The path of a trial from what the trial itself keeps: as far as the reference came, and so not known to be whole.
/// Nothing without a reference.
std::optional<TrialPath> path_of(const RecordedTrial& trial);

/// What a trial was like. What is undefined stays so.
struct TrialFigures {
  double duration = 0;                        ///< of the trial [s]
  std::optional<Deviation> deviation;         ///< from the reference at the same instant; of passive and cursor trials
  std::optional<Deviation> contour;           ///< from the path, wherever on it
  std::optional<double> time_in_tunnel;       ///< share of the time, 0 to 1; of a cursor trial, round the cursor
  std::optional<double> completion;           ///< share of the path that was walked, 0 to 1; of a path that is whole
  std::optional<double> shape_distance;       ///< of the whole path to what was walked (dynamic time warping) [m]; of
                                              ///< trials that came to the end, by no more than ten times its length
  std::optional<ForceDeviation> force_error;  ///< the felt force against the expert's, by place; where it was replayed
  std::optional<MovementFigures> movement;
};

/// `plant`: for the estimate of the person's work. Lengths are those of the path that was walked. Of who walked less
/// than 5 % of it, or 2 mm, those figures are undefined that compare his way or the forces along it.
TrialFigures trial_figures(const RecordedTrial& trial, const std::optional<TrialPath>& path,
                           const std::optional<PlantModel>& plant = std::nullopt);

/// One figure of a trial by name.
struct TrialFigure {
  const char* name;   ///< with its unit, as in JSON and CSV: contour_rms_m
  const char* title;  ///< for people, in the unit below
  const char* unit;   ///< that people read; "" for none
  double scale;       ///< of that unit
  int digits;         ///< after the point, for people
  int better;         ///< -1: less is better; 1: more is; 0: neither
  std::optional<double> (*value)(const TrialFigures& figures);
  const char* meaning;  ///< how it is defined, and after whom: a sentence
};

/// Every figure, in the order of reports.
std::span<const TrialFigure> all_trial_figures();

/// Throws Error(input) with the nearest name when there is none of this name.
const TrialFigure& trial_figure(std::string_view name);

/// Every figure by its name; null where it is undefined.
nlohmann::json to_json(const TrialFigures& figures);

/// The figure of this name in what to_json() made; nothing where it is undefined or missing, or `figures` is no object.
std::optional<double> figure_in(const nlohmann::json& figures, std::string_view name);

}  // namespace haptrace
