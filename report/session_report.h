// Sessions of programmes and single recordings, with their metrics, as plain data. A page, a table and a JSON object
// show this data.
#pragma once

#include "formats/documents/norms.h"
#include "formats/documents/programme.h"
#include "formats/documents/session_log.h"
#include "metrics/assessment_summary.h"
#include "metrics/learning_curve.h"
#include "metrics/position_sense.h"
#include "metrics/reach_blocks.h"
#include "metrics/recorded_trial.h"
#include "metrics/touches.h"

#include <functional>
#include <map>
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
  bool at_limit = false;                ///< of a range and a press: the person may be capable of more
  std::optional<int> answer;            ///< of a pair of places: 1, 2; 0: none
  std::string target;                   ///< of a reach, in words: its target, block and kind; else empty
  std::optional<double> pace, radius, stiffness, assistance, level, support;  ///< see TrialSettings
  double duration = 0;                                                        ///< [s]
  std::size_t samples = 0;  ///< rows of its recording; 0 if it is missing
  /// Rank within its exercise by the main metric, from 1; repetitions that ran out of time come after all finished
  /// ones, by their share of the path. None if it was stopped, or where the metric has no better direction.
  std::optional<int> rank;
  std::vector<std::optional<double>> figures;  ///< one per entry of all_trial_figures()

  std::vector<Vec3> way;      ///< path of the hand, thinned [m]
  ReportLine deviation;       ///< distance from the path [m]
  std::vector<double> force;  ///< magnitude of the felt force along the path, mean of each cell [N]; NaN where none

  [[nodiscard]] bool finished() const { return stopped_by == "finished"; }
  /// Returns whether time ran out. Such a repetition has metrics of the part that was done. Only its completion counts
  /// in a trend; in a summary it ranks below every finished repetition.
  [[nodiscard]] bool out_of_time() const { return stopped_by == "time_over"; }
  /// Returns the end in words, with the share of the path that a repetition covered which ran out of time.
  [[nodiscard]] std::string end_in_words() const;
};

/// A metric over the repetitions of one exercise in one session. Repetitions that ran out of time are worse than every
/// finished one; a quantile that falls among them is NaN.
struct ReportSummary {
  double median = 0, better_quartile = 0, worse_quartile = 0;  ///< SI; NaN where undefined
  std::size_t finished = 0;                                    ///< finished repetitions in which it is defined
  std::size_t partial = 0;                                     ///< repetitions that ran out of time
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
  std::optional<std::size_t> task;   ///< equal paths have equal numbers; none for a recording, or an unreadable path
  double path_length = 0;            ///< [m]; 0 without a path
  std::vector<Vec3> curve;           ///< the path, thinned [m]
  ReportLine radius;                 ///< tunnel radius of the last repetition
  double farthest = 0;               ///< progress of the repetition that came farthest [m]
  double cell = 1e-3;                ///< length of the cells of forces along the path [m]
  std::vector<double> expert_force;  ///< magnitude along the path, as the trainee should feel it [N]; empty without
  std::string figure;                ///< primary metric, shown in the summary; empty when none is defined
  bool figure_named = false;         ///< the programme named it
  std::vector<ReportTrial> trials;
  std::vector<ReportTrend> trends;        ///< for every metric that is defined in a finished repetition
  std::vector<ReachBlockSummary> blocks;  ///< of a reaching exercise
  std::optional<AssessmentSummary> assessment;
  std::optional<SenseSummary> sense;
  std::string reach;  ///< of a task by places: what must not differ between sessions that compare; else empty

  /// Returns false for an assessment of directions or pairs: they differ, so that none is typical.
  [[nodiscard]] bool has_typical_trial() const { return !sense && !(assessment && !assessment->directions.empty()); }
  [[nodiscard]] std::size_t finished() const;
  [[nodiscard]] std::size_t out_of_time() const;
};

/// Returns the summary of a metric of an exercise.
ReportSummary summary_of(const ReportExercise& exercise, std::size_t figure);

/// Returns why the median of such a summary is undefined, as part of a sentence.
std::string why_undefined(const ReportExercise& exercise, std::size_t figure);

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
  std::string created;                      ///< RFC 3339
  std::string software;                     ///< software that recorded it
  std::string device;                       ///< in words
  double device_force = 0;                  ///< largest force of the device [N]; 0: not recorded
  std::optional<double> force_limit;        ///< limit of the session, if one was set [N]
  std::map<std::string, std::string> meta;  ///< metadata of the operator, as side, protocol, protocol-reference, age
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
  /// One test of one session: repetitions of different sessions are never pooled.
  struct Group {
    std::string test;                       ///< before | after | retention
    std::size_t session = 0, exercise = 0;  ///< indices into Report::sessions and its exercises
    std::vector<ReportSummary> summaries;   ///< by metric
  };
  std::string subject, task;           ///< in words
  std::optional<std::size_t> session;  ///< index into Report::sessions; set if the participant has no name
  std::vector<Group> groups;           ///< in the order of the tests; only existing ones
};

/// One exercise of one participant over sessions: equal path, mode and test label.
struct ReportCourse {
  struct Point {
    std::size_t session = 0, exercise = 0;  ///< indices into Report::sessions and its exercises
    double day = 0;                         ///< since the first point; NaN without a date
  };
  std::vector<Point> points;  ///< one per session, in the order of their dates
};

/// One participant. Sessions without a name belong to different participants.
struct ReportPerson {
  std::string name;                   ///< as recorded, or words for a session without a name
  std::vector<std::size_t> sessions;  ///< indices into Report::sessions
  std::vector<ReportCourse> courses;  ///< only those with several sessions
};

struct Report {
  std::vector<ReportSession> sessions;        ///< sorted by their start
  std::vector<ReportComparison> comparisons;  ///< only those with several tests
  std::vector<ReportPerson> persons;          ///< sorted by their first session
  std::optional<Norms> norms;                 ///< set by set_norms()
};

/// Sets the norms, from which changes are judged. If they hold for no exercise, the sessions' remarks say so. Throws
/// Error(input) naming the file for a metric that does not exist.
void set_norms(Report& report, Norms norms);

/// Returns whether the norms hold for an exercise of the report, for any of their metrics.
bool norms_hold(const Report& report);

/// Reads sessions (their folders, or their session.json) and recordings, with their metrics. Metrics of a session's
/// repetitions come from its log, so that both agree. For a recording, and where the log has none, they are computed
/// from the rows. If a recording of a session is missing or damaged, `remarks` names it and its repetition has no
/// curves. An input that is given twice, under any name, counts once. The function reports each input to `progress`,
/// then each recording of a session.
///
/// The memory is that of the longest recording. Throws Error(input) naming the file when an input is neither a session
/// nor a recording, or cannot be read. A recording of a minute at 1 kHz takes less than 0.1 s of a 2.5 GHz Xeon.
/// Threads: free function without state.
///
/// `done` of `progress` is the share of the inputs that was read.
Report gather_report(std::span<const std::string> inputs,
                     const std::function<void(const std::string& file, double done)>& progress = {});

/// Throws Error(input) naming an output that would replace an input file of the report (recordings with their further
/// parts; log, profile, paths and recordings of sessions), the log of any session, or another output. Links are
/// followed. Throws like gather_report when the log of a session cannot be read.
void check_report_outputs(std::span<const std::string> outputs, std::span<const std::string> inputs);

/// Returns all numbers except curves, which are in the recordings. SI; null where a value is undefined.
nlohmann::json to_json(const Report& report);

}  // namespace haptrace
