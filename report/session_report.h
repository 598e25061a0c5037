// Sessions of programmes and single recordings, with their metrics, as plain data. A page, a table and a JSON object
// show this data.
#pragma once

#include "formats/documents/programme.h"
#include "formats/documents/session_log.h"
#include "metrics/learning_curve.h"
#include "metrics/recorded_trial.h"
#include "metrics/touches.h"

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// Values along a path, thinned for drawing. No value is farther from the line than 1/2000 of the largest, unless that
/// leaves too many points.
struct ReportLine {
  std::vector<double> arc;    ///< [m]
  std::vector<double> value;  ///< SI
};

/// One repetition.
struct ReportTrial {
  int round = 1, repetition = 1, attempt = 1;
  std::string began;                    ///< RFC 3339; may be empty
  std::string file;                     ///< its recording, with the name in the session
  std::string stopped_by = "finished";  ///< "finished", or the reason of the end; empty if it was not written down
  std::string detail;                   ///< details of the reason, in words
  std::string missing;                  ///< reason why its recording is not drawn; empty when it is
  std::optional<double> pace, radius, stiffness, assistance, level;  ///< see TrialSettings
  double duration = 0;                                               ///< [s]
  std::vector<std::optional<double>> figures;                        ///< one per entry of all_trial_figures()

  std::vector<Vec3> way;      ///< path of the hand, thinned [m]
  ReportLine deviation;       ///< distance from the path [m]
  std::vector<double> force;  ///< magnitude of the felt force along the path, mean of each cell [N]; NaN where none

  [[nodiscard]] bool finished() const { return stopped_by == "finished"; }
  /// Returns whether time ran out. Such a partial repetition has metrics of the part that was done. Only its completion
  /// counts in a trend. In comparisons it ranks below every finished one.
  [[nodiscard]] bool out_of_time() const { return stopped_by == "time_over"; }
  [[nodiscard]] std::string end_in_words() const;
};

/// A metric over the repetitions of an exercise. Repetitions that were not finished count as not measured.
struct ReportTrend {
  std::size_t figure = 0;              ///< index into all_trial_figures()
  std::vector<double> values;          ///< by repetition, NaN where undefined
  std::optional<LearningCurve> curve;  ///< the better of both laws; only for metrics of which less is better
  std::optional<LearningTrend> line;
};

struct ReportExercise {
  std::string name;
  std::string mode;  ///< mode of a programme, see ExerciseMode; "playback" or "recording" for other recordings
  std::string test;  ///< "before", "after", "retention", or empty
  bool warm_up = false;
  std::string path;                  ///< source of the path, in words
  std::optional<std::size_t> task;   ///< for tests: equal paths have equal numbers; none if the path cannot be read
  double path_length = 0;            ///< [m]; 0 without a path
  std::vector<Vec3> curve;           ///< the path, thinned [m]
  ReportLine radius;                 ///< tunnel radius of the last repetition
  double farthest = 0;               ///< progress of the repetition that came farthest [m]
  double cell = 1e-3;                ///< length of the cells of forces along the path [m]
  std::vector<double> expert_force;  ///< magnitude along the path, as the trainee should feel it [N]; empty without
  std::string figure;                ///< main metric, shown in the summary; empty when none is defined
  std::vector<ReportTrial> trials;
  std::vector<ReportTrend> trends;  ///< for every metric that is defined in a finished repetition
};

/// An event of one recording; it may occur several times.
struct ReportEvent {
  enum class Kind { stop, warning, mark };
  Kind kind = Kind::warning;
  std::string where;           ///< exercise and repetition, in words
  std::optional<double> time;  ///< time of the first one, since the first row of the recording [s]
  int times = 1;
  std::string text;  ///< text of the first one
};

/// One session of a programme, or one recording.
struct ReportSession {
  std::string source;  ///< input as given by the user
  std::string title, subject, operator_name, notes;
  std::string created;   ///< RFC 3339
  std::string software;  ///< software that recorded it
  std::string device;    ///< in words
  bool complete = false;
  bool steered = false;  ///< a person steered a simulated hand: no trend or comparison contains it
  double duration = 0;   ///< including rests [s]
  std::vector<Sitting> sittings;
  std::vector<ReportExercise> exercises;
  std::vector<ReportEvent> events;
  std::vector<TouchFigures> touches;  ///< of a recording with a scene: every object, touched or not
  std::vector<std::string> remarks;   ///< warnings for the reader: missing or unfinished parts
  nlohmann::json settings;            ///< the programme, or the configuration of the recording
};

/// The unguided tests of one participant on one path, whatever its name; without a participant's name, those of one
/// session.
struct ReportComparison {
  struct Group {
    std::string test;                         ///< before | after | retention
    std::vector<std::vector<double>> values;  ///< by metric: values of all finished repetitions in which it is defined
    std::vector<double> partial;              ///< completion of the partial ones, NaN where unknown

    [[nodiscard]] double mean(std::size_t figure) const;    ///< NaN without values
    [[nodiscard]] double spread(std::size_t figure) const;  ///< standard deviation; NaN for fewer than two values
    /// Returns the median over finished and partial repetitions. A partial one counts as worse than every finished one.
    /// NaN if the median is partial, or if neither more nor less is better.
    [[nodiscard]] double ranked_median(std::size_t figure) const;
    /// Returns the mean, or with partial repetitions the ranked median, where there is one.
    [[nodiscard]] double typical(std::size_t figure) const;
  };
  std::string subject, task;           ///< in words
  std::optional<std::size_t> session;  ///< index into Report::sessions; set if the participant has no name
  std::vector<Group> groups;           ///< in the order of the tests; only existing ones
};

struct Report {
  std::vector<ReportSession> sessions;        ///< sorted by their start
  std::vector<ReportComparison> comparisons;  ///< only those with several tests
};

/// Reads sessions (their folders, or their session.json) and recordings, with their metrics. Metrics of a session's
/// repetitions come from its log, so that both agree. For a recording, and where the log has none, they are computed
/// from the rows. If a recording of a session is missing or damaged, `remarks` names it and its repetition has no
/// curves. An input that is given twice, under any name, counts once. The function reports each input to `progress`,
/// then each recording of a session.
///
/// The memory is that of the longest recording. Throws Error(input) naming the file when an input is neither a session
/// nor a recording, or cannot be read. Threads: free function without state.
Report gather_report(std::span<const std::string> inputs,
                     const std::function<void(const std::string& file)>& progress = {});

/// Throws Error(input) naming an output that would replace an input file of the report (recordings with their further
/// parts; log, profile, paths and recordings of sessions), the log of any session, or another output. Links are
/// followed. Throws like gather_report when the log of a session cannot be read.
void check_report_outputs(std::span<const std::string> outputs, std::span<const std::string> inputs);

/// Returns all numbers except curves, which are in the recordings. SI; null where a value is undefined.
nlohmann::json to_json(const Report& report);

}  // namespace haptrace
