// What was done with a device and how it went: sessions of programmes and single recordings as plain data, which a
// page, a table and a JSON object show.
#pragma once

#include "formats/documents/programme.h"
#include "formats/documents/session_log.h"
#include "metrics/learning_curve.h"
#include "metrics/recorded_trial.h"

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// Values along a path, thinned for drawing: no value is farther from the line than 1/2000 of the largest, as long as
/// that leaves few enough points.
struct ReportLine {
  std::vector<double> arc;    ///< [m]
  std::vector<double> value;  ///< SI
};

/// One repetition.
struct ReportTrial {
  int round = 1, repetition = 1, attempt = 1;
  std::string began;                    ///< RFC 3339; may be empty
  std::string file;                     ///< its recording, as the session names it
  std::string stopped_by = "finished";  ///< or what ended it; empty when nobody could write that down
  std::string detail;                   ///< of that, in words
  std::string missing;                  ///< why its recording is not drawn; empty when it is
  std::optional<double> pace, radius, stiffness, assistance, level;  ///< what it was set to, see TrialSettings
  double duration = 0;                                               ///< [s]
  std::vector<std::optional<double>> figures;                        ///< one for each of all_trial_figures()

  std::vector<Vec3> way;      ///< of the hand, thinned [m]
  ReportLine deviation;       ///< distance from the path [m]
  std::vector<double> force;  ///< magnitude of the felt force by place, mean of each cell [N]; NaN where none was

  [[nodiscard]] bool finished() const { return stopped_by == "finished"; }
  /// Done, but not finished: its figures are of what was done until then, and count in nothing that is made of several.
  [[nodiscard]] bool out_of_time() const { return stopped_by == "time_over"; }
  [[nodiscard]] std::string end_in_words() const;
};

/// How a figure went over the repetitions of an exercise. Those that were not finished count as not measured.
struct ReportTrend {
  std::size_t figure = 0;              ///< of all_trial_figures()
  std::vector<double> values;          ///< by repetition, NaN where undefined
  std::optional<LearningCurve> curve;  ///< the better of both laws; of figures of which less is better
  std::optional<LearningTrend> line;
};

struct ReportExercise {
  std::string name;
  std::string mode;  ///< of a programme, see ExerciseMode; "playback" and "recording" of what else was recorded
  std::string test;  ///< "before", "after", "retention", or empty
  bool warm_up = false;
  std::string path;                  ///< where it comes from, in words
  std::optional<std::size_t> task;   ///< of tests: the same number for the same curve; none where it cannot be read
  double path_length = 0;            ///< [m]; 0 without a path
  std::vector<Vec3> curve;           ///< the path, thinned [m]
  ReportLine radius;                 ///< of the tunnel, as it was last
  double cell = 1e-3;                ///< of forces by place [m]
  std::vector<double> expert_force;  ///< magnitude by place, as it was to be felt [N]; empty without
  std::string figure;                ///< by which it is told in a sentence; empty when none is defined
  std::vector<ReportTrial> trials;
  std::vector<ReportTrend> trends;  ///< of every figure that is defined in a finished repetition
};

/// Something that happened, once or often, in one recording.
struct ReportEvent {
  enum class Kind { stop, warning, mark };
  Kind kind = Kind::warning;
  std::string where;           ///< which exercise and repetition, in words
  std::optional<double> time;  ///< of the first, since the recording's first row [s]
  int times = 1;
  std::string text;  ///< of the first
};

/// One session of a programme, or one recording.
struct ReportSession {
  std::string source;  ///< as it was given
  std::string title, subject, operator_name, notes;
  std::string created;   ///< RFC 3339
  std::string software;  ///< that recorded it
  std::string device;    ///< in words
  bool complete = false;
  double duration = 0;  ///< rests included [s]
  std::vector<Sitting> sittings;
  std::vector<ReportExercise> exercises;
  std::vector<ReportEvent> events;
  std::vector<std::string> remarks;  ///< what a reader must know: what is missing, what was not finished
  nlohmann::json settings;           ///< the programme, or the recording's configuration
};

/// The unguided tests of one person on one curve, by whatever name; of somebody without a name, those of one session.
struct ReportComparison {
  struct Group {
    std::string test;                         ///< before | after | retention
    std::vector<std::vector<double>> values;  ///< by figure: of every finished repetition in which it is defined

    [[nodiscard]] double mean(std::size_t figure) const;    ///< NaN without values
    [[nodiscard]] double spread(std::size_t figure) const;  ///< standard deviation; NaN of fewer than two
  };
  std::string subject, task;           ///< in words
  std::optional<std::size_t> session;  ///< of Report::sessions, the only one, when the person has no name
  std::vector<Group> groups;           ///< in that order; those that there are
};

struct Report {
  std::vector<ReportSession> sessions;        ///< by when they were begun
  std::vector<ReportComparison> comparisons;  ///< where there is something to compare
};

/// Reads sessions (their folders, or their session.json) and recordings, and takes their figures. Those of a session's
/// repetitions are what its log says, so that both agree; of a recording, and where the log has none, they are taken
/// from its rows. A recording of a session that is missing or damaged is named in `remarks` and leaves its repetition
/// without curves. An input that is given twice, by whatever name, counts once. `progress` is told each input, then
/// each recording of a session.
///
/// Memory is that of the longest recording. Throws Error(input) naming the file: an input that is neither, or cannot be
/// read. Threads: free function without state.
Report gather_report(std::span<const std::string> inputs,
                     const std::function<void(const std::string& file)>& progress = {});

/// Throws Error(input) naming the output that would take the place of a file which such a report is made of (recordings
/// with their further parts; of sessions log, profile, paths and recordings), of any session's log, or of another
/// output. Links are followed. Throws like gather_report when a session's log cannot be read.
void check_report_outputs(std::span<const std::string> outputs, std::span<const std::string> inputs);

/// All numbers but curves, which are in the recordings. SI; null where something is undefined.
nlohmann::json to_json(const Report& report);

}  // namespace haptrace
