#include "report/session_report.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/statistics.h"
#include "control/event_words.h"
#include "formats/documents/warning_json.h"
#include "formats/path/path_file.h"
#include "report/course.h"
#include "report/thinning.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <map>
#include <numeric>
#include <set>
#include <tuple>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kWayPoints = 400, kLinePoints = 300;
constexpr double kForceCells = 250;

/// The path with which repetitions are compared.
struct DrawnPath {
  TrialPath path;
  double cell = 1e-3;  ///< [m]

  explicit DrawnPath(TrialPath of)
      : path(std::move(of)), cell(std::max(path.spacing, path.curve.length() / kForceCells)) {}
};

std::vector<double> magnitudes(const std::vector<Vec3>& forces, double scale = 1) {
  std::vector<double> result;
  for (const Vec3& force : forces) result.push_back(std::abs(scale) * force.norm());
  return result;
}

/// Returns the means over neighbouring cells of the path's own spacing.
std::vector<double> expert_force(const DrawnPath& drawn, double scale) {
  if (drawn.path.expert.empty() || scale == 0) return {};
  std::vector<double> arc;
  for (std::size_t i = 0; i < drawn.path.expert.size(); ++i)
    arc.push_back((static_cast<double>(i) + 0.5) * drawn.path.spacing);
  return magnitudes(force_by_arc_length(arc, drawn.path.expert, drawn.path.curve.length(), drawn.cell), scale);
}

/// Returns the alignment of a repetition with its path; nothing without a path of some length.
std::optional<PathAlignment> alignment_of(const RecordedTrial& recorded, const std::optional<DrawnPath>& drawn) {
  if (recorded.reach || !drawn || !(drawn->path.curve.length() > 0)) return std::nullopt;
  return align_with_path(drawn->path.curve, recorded.position);
}

/// Adds the curves of a repetition.
void add_curves(ReportTrial& trial, const RecordedTrial& recorded, const std::optional<DrawnPath>& drawn,
                const std::optional<PathAlignment>& alignment) {
  trial.samples = recorded.time.size();
  trial.way = thinned(recorded.position, kWayPoints);
  if (!alignment) return;
  const Polyline& curve = drawn->path.curve;
  const std::vector<double>& arc = alignment->arc;
  std::vector<double> distance;
  for (std::size_t i = 0; i < arc.size(); ++i) distance.push_back((recorded.position[i] - curve.at(arc[i])).norm());
  trial.deviation = thinned(arc, distance, kLinePoints);
  if (!recorded.force.empty())
    trial.force = magnitudes(force_by_arc_length(arc, recorded.force, curve.length(), drawn->cell, alignment->jumps));
}

/// Sets the tunnel radius along the path: that of the last repetition that came about as far as the farthest.
void add_tunnel(ReportExercise& exercise, const RecordedTrial& trial) {
  if (trial.radius.empty() || trial.progress.empty()) return;
  constexpr double kAboutAsFar = 0.95;
  ReportLine line;
  double farthest = -1;
  for (std::size_t i = 0; i < trial.progress.size(); ++i) {
    if (!(trial.progress[i] > farthest) || !std::isfinite(trial.radius[i])) continue;
    farthest = trial.progress[i];
    line.arc.push_back(farthest);
    line.value.push_back(trial.radius[i]);
  }
  line = thinned(line.arc, line.value, kLinePoints);
  if (line.arc.empty()) return;
  exercise.farthest = std::max(exercise.farthest, line.arc.back());
  if (line.arc.back() >= kAboutAsFar * exercise.farthest) exercise.radius = std::move(line);
}

void add_path(ReportExercise& exercise, const std::optional<DrawnPath>& drawn, double force_scale) {
  if (!drawn) return;
  exercise.path_length = drawn->path.curve.length();
  exercise.cell = drawn->cell;
  exercise.expert_force = expert_force(*drawn, force_scale);
  const double length = exercise.path_length;
  exercise.curve = thinned(drawn->path.curve.resampled(std::max(1e-4, length / 20'000)), 2 * kWayPoints);
}

std::vector<std::optional<double>> values_of(const TrialFigures& figures) {
  std::vector<std::optional<double>> values;
  for (const TrialFigure& figure : all_trial_figures()) values.push_back(figure.value(figures));
  return values;
}

/// Computes the metrics of a repetition, and its curves.
std::vector<std::optional<double>> add_recorded(ReportTrial& trial, const RecordedTrial& recorded,
                                                const std::optional<DrawnPath>& drawn,
                                                const std::optional<PlantModel>& plant, bool figures) {
  const std::optional<PathAlignment> alignment = alignment_of(recorded, drawn);
  add_curves(trial, recorded, drawn, alignment);
  if (!figures) return trial.figures;
  return values_of(trial_figures(recorded, drawn ? std::optional(drawn->path) : std::optional<TrialPath>(), plant,
                                 alignment ? &*alignment : nullptr));
}

/// Returns the metrics from a session log.
std::vector<std::optional<double>> values_of(const nlohmann::json& figures) {
  std::vector<std::optional<double>> values;
  for (const TrialFigure& figure : all_trial_figures()) values.push_back(figure_in(figures, figure.name));
  return values;
}

/// Returns whether metrics of a log have the present definitions. Those of older versions are not comparable.
bool has_present_definitions(const nlohmann::json& figures) {
  return figure_in(figures, "definitions") == static_cast<double>(kFigureDefinitions);
}

std::string in_words(const std::string& a, const std::string& b) {
  return a.empty() || b.empty() || a == b ? a + (a == b ? "" : b) : fmt::format("{} ({})", a, b);
}

/// Marks a session whose simulated hand a person steered through the live view.
void mark_steered(ReportSession& session) {
  session.steered = true;
  session.remarks.emplace_back(
      "a person steered a simulated hand through the live view, so the metrics do not measure skill at a device; no "
      "trend or comparison contains them");
}

// Events.

bool is_stop(EventCode code) {
  const EventWords* words = words_of(code);
  return words != nullptr && words->stops;
}

bool is_told(EventCode code) {
  return code != EventCode::started && code != EventCode::finished && code != EventCode::repetition &&
         code != EventCode::touched && code != EventCode::left && code != EventCode::initiation;
}

/// Adds the warnings of one recording that are not among its events.
void add_warnings(std::vector<ReportEvent>& to, const RecordingHeader& header, const std::string& place) {
  for (const Warning& warning : warnings_from(header.warnings))
    if (warning.severity != Severity::note && !is_of_event(warning.code) && warning.code != "stopped")
      to.push_back({.where = place, .text = warning.text});
}

/// Adds the events of one recording; repeated events are added once, with their number. `place` returns the place of an
/// event in words.
void add_events(std::vector<ReportEvent>& to, const std::vector<StoredEvent>& events,
                const std::function<std::string(double time)>& place) {
  std::map<std::pair<std::int32_t, std::string>, std::size_t> known;
  for (const StoredEvent& event : events) {
    const auto code = static_cast<EventCode>(event.code);
    if (!is_told(code)) continue;
    const std::string where = place(event.time);
    const bool mark = code == EventCode::mark || code == EventCode::input;
    const auto [found, added] = mark ? std::pair{known.end(), true} : known.try_emplace({event.code, where}, to.size());
    if (!added) {
      ++to[found->second].times;
      continue;
    }
    to.push_back({.kind = mark            ? ReportEvent::Kind::mark
                          : is_stop(code) ? ReportEvent::Kind::stop
                                          : ReportEvent::Kind::warning,
                  .where = where,
                  .time = event.time,
                  .text = event.text});
  }
}

// Trends, and the main metric of an exercise.

std::size_t index_of(std::string_view name) {
  return static_cast<std::size_t>(&trial_figure(name) - all_trial_figures().data());
}

/// Returns whether a metric of a repetition counts in a trend. Only the completion of a partial one does.
bool counts(const ReportTrial& trial, std::size_t figure) {
  return trial.finished() || (trial.out_of_time() && figure == index_of("completion"));
}

std::vector<double> column(const ReportExercise& exercise, std::size_t figure) {
  std::vector<double> values;
  for (const ReportTrial& trial : exercise.trials)
    values.push_back(counts(trial, figure) ? trial.figures[figure].value_or(kNaN) : kNaN);
  return values;
}

std::optional<LearningCurve> better_curve(const std::vector<double>& values) {
  std::optional<LearningCurve> best;
  for (const LearningLaw law : {LearningLaw::power, LearningLaw::exponential})
    if (const auto curve = fit_learning_curve(values, law); curve && (!best || curve->r_squared > best->r_squared))
      best = curve;
  return best;
}

/// Ranks the repetitions by the primary metric: finished ones first, then those that ran out of time by their share of
/// the path.
void rank(ReportExercise& exercise) {
  const std::size_t completion = index_of("completion");
  const std::size_t figure = exercise.figure.empty() ? completion : index_of(exercise.figure);
  const int better = all_trial_figures()[figure].better;
  if (better == 0) return;
  std::vector<ReportTrial*> ranked;
  for (ReportTrial& trial : exercise.trials)
    if (trial.out_of_time() || (trial.finished() && trial.figures[figure])) ranked.push_back(&trial);
  const auto key = [&](const ReportTrial* trial) {
    return trial->finished() ? std::pair(0, -better * *trial->figures[figure])
                             : std::pair(1, -trial->figures[completion].value_or(0));
  };
  std::stable_sort(ranked.begin(), ranked.end(),
                   [&](const ReportTrial* a, const ReportTrial* b) { return key(a) < key(b); });
  for (std::size_t i = 0; i < ranked.size(); ++i) ranked[i]->rank = static_cast<int>(i) + 1;
}

/// `asked` is the metric that the programme uses; it may be empty.
void add_trends(ReportExercise& exercise, const std::string& asked) {
  const std::span<const TrialFigure> figures = all_trial_figures();
  const auto defined = [&](std::size_t figure) {
    return std::any_of(exercise.trials.begin(), exercise.trials.end(),
                       [&](const ReportTrial& trial) { return counts(trial, figure) && trial.figures[figure]; });
  };
  for (std::size_t i = 0; i < figures.size(); ++i) {
    if (!defined(i)) continue;
    ReportTrend trend{.figure = i, .values = column(exercise, i), .curve = {}, .line = {}};
    trend.line = fit_trend(trend.values);
    if (figures[i].better < 0) trend.curve = better_curve(trend.values);
    exercise.trends.push_back(std::move(trend));
  }
  if (!exercise.has_typical_trial()) return;
  const bool own_time = exercise.mode == "passive" || exercise.mode == "cursor" || exercise.mode == "playback";
  for (const std::string& name : {asked, std::string(own_time ? "deviation_rms_m" : "contour_rms_m"),
                                  std::string("tracking_rms_m"), std::string("movement_time_s")})
    if (!name.empty() && defined(index_of(name))) {
      exercise.figure = name;
      exercise.figure_named = name == asked;
      break;
    }
  rank(exercise);
}

// A single recording.

std::string device_in_words(const RecordingHeader& header) {
  return in_words(header.device_name, header.device_model);
}

std::string mode_of(TrialKind kind, const nlohmann::json& config) {
  switch (kind) {
    case TrialKind::passive:
      return "playback";
    case TrialKind::cursor:
      return "cursor";
    case TrialKind::guided:
      return text_in(config, "mode") == "free" ? "free" : "tunnel";
    case TrialKind::reach: {
      const std::string mode = text_in(config, "mode");
      return mode.empty() ? "reach" : mode;
    }
    case TrialKind::free:
      break;
  }
  return "recording";
}

std::optional<double> typical(std::vector<double> values) {
  std::erase_if(values, [](double v) { return !std::isfinite(v); });
  return values.empty() ? std::nullopt : std::optional(median(std::move(values)));
}

/// Sets the end of every repetition of a recording. Files without events come from other programs and count as
/// finished.
void tell_ends(std::vector<ReportTrial>& trials, const std::vector<RecordedTrial>& recorded,
               const std::vector<StoredEvent>& events, bool complete) {
  if (trials.empty()) return;
  const auto last_time = recorded.back().time.back();
  bool finished = events.empty(), stopped = false;
  for (const StoredEvent& event : events) {
    const auto code = static_cast<EventCode>(event.code);
    if (code == EventCode::finished) finished = true;
    if (code == EventCode::time_over) {
      for (std::size_t i = 0; i < trials.size(); ++i)
        if (event.time >= recorded[i].time.front() - 1e-6 &&
            (i + 1 == trials.size() || event.time < recorded[i + 1].time.front())) {
          trials[i].stopped_by = "time_over";
          trials[i].detail = event.text;
        }
    } else if (is_stop(code) && event.time >= recorded.back().time.front() && !stopped) {
      stopped = true;
      trials.back().stopped_by = code == EventCode::interrupted ? "interrupted" : "limit";
      trials.back().detail = event.text;
    }
  }
  if (finished && trials.back().stopped_by != "time_over") trials.back().stopped_by = "finished";
  if (!complete && !finished && !stopped) {
    trials.back().stopped_by = "";
    trials.back().detail = fmt::format("the recording ends at {:.2f} s", last_time);
  }
}

/// Returns false if a path that was put together from the places of a trial lacks parts, because the place skipped
/// them: it is then shorter than the arc length that the trials reached.
bool has_no_gap(const Polyline& curve, const std::vector<RecordedTrial>& trials) {
  constexpr double kWhole = 0.98;
  double farthest = 0;
  for (const RecordedTrial& trial : trials)
    for (const double s : trial.progress)
      if (s > farthest) farthest = s;
  return curve.length() >= kWhole * farthest;
}

std::optional<double> force_limit_of(const RecordingHeader& header) {
  const std::optional<double> limit = number_in(header.config, "max-force");
  return limit && *limit > 0 ? limit : std::nullopt;
}

/// Returns the facts of a recording, without its repetitions. `name`: that of its file.
ReportSession facts_of(const RecordingReader& reader, const RecordingHeader& header, const std::string& file,
                       const std::string& name) {
  ReportSession session{.source = file,
                        .title = header.title.empty() ? name : header.title,
                        .subject = header.subject,
                        .operator_name = header.operator_name,
                        .notes = header.notes,
                        .created = header.created,
                        .software = header.software,
                        .device = device_in_words(header),
                        .device_force = header.max_force_n,
                        .force_limit = force_limit_of(header),
                        .meta = header.meta,
                        .complete = header.complete,
                        .settings = header.config};
  if (const auto input = header.meta.find("input"); input != header.meta.end() && input->second == "view")
    mark_steered(session);
  if (!header.complete) session.remarks.push_back(name + " is incomplete; the report shows its stored samples");
  if (reader.rows() == 0) session.remarks.push_back(name + " contains no samples");
  return session;
}

/// Returns the largest force that carried the arm in a repetition; nothing if none could.
std::optional<double> largest_support(const RecordedTrial& trial) {
  std::optional<double> largest;
  for (const Vec3& support : trial.support)
    if (support.allFinite()) largest = std::max(largest.value_or(0), support.norm());
  return largest;
}

/// Returns the exercise of a recording with its repetitions, without figures and curves.
ReportExercise exercise_of(const std::vector<RecordedTrial>& recorded, const RecordingHeader& header,
                           const std::string& title, const std::string& name) {
  const std::string expert = text_in(header.config, "expert"), path_name = text_in(header.config, "path");
  ReportExercise exercise{.name = title,
                          .mode = recorded.empty() ? "recording" : mode_of(recorded.front().kind, header.config),
                          .path = expert.empty() ? path_name : expert};
  const bool alone = exercise.mode == "free";
  for (const RecordedTrial& one : recorded) {
    const bool guided = (one.kind == TrialKind::guided || one.kind == TrialKind::cursor) && !alone;
    exercise.trials.push_back({.repetition = one.repetition,
                               .file = name,
                               .pace = one.kind == TrialKind::passive || one.kind == TrialKind::cursor
                                           ? number_in(header.config, "speed")
                                           : std::nullopt,
                               .radius = alone ? std::nullopt : typical(one.radius),
                               .stiffness = guided ? number_in(header.config, "stiffness") : std::nullopt,
                               .support = largest_support(one),
                               .duration = one.time.back() - one.time.front()});
  }
  return exercise;
}

/// Returns the path that all repetitions share. The one that came farthest knows most of it.
std::optional<DrawnPath> shared_path(const std::vector<RecordedTrial>& recorded,
                                     const std::vector<ReportTrial>& trials) {
  std::optional<DrawnPath> drawn;
  for (const RecordedTrial& one : recorded)
    if (std::optional<TrialPath> path = path_of(one);
        path && (!drawn || path->curve.length() > drawn->path.curve.length()))
      drawn.emplace(std::move(*path));
  if (drawn)
    drawn->path.whole =
        has_no_gap(drawn->path.curve, recorded) &&
        std::any_of(trials.begin(), trials.end(), [](const ReportTrial& trial) { return trial.finished(); });
  return drawn;
}

ReportSession session_of_recording(const std::string& file) {
  const RecordingReader reader(file);
  const RecordingHeader header = reader.header();
  const std::vector<RecordedTrial> recorded = read_trials(reader, file);
  const std::vector<StoredEvent> events = reader.events();
  const std::string name = fs::path(file).filename().string();

  ReportSession session = facts_of(reader, header, file, name);
  ReportExercise exercise = exercise_of(recorded, header, session.title, name);
  tell_ends(exercise.trials, recorded, events, header.complete);

  const std::optional<DrawnPath> drawn = shared_path(recorded, exercise.trials);
  const double scale = recorded.empty() ? 1 : recorded.back().force_scale;
  add_path(exercise, drawn, scale);
  for (std::size_t i = 0; i < recorded.size(); ++i) {
    ReportTrial& trial = exercise.trials[i];
    trial.figures = add_recorded(trial, recorded[i], drawn, std::nullopt, true);
    add_tunnel(exercise, recorded[i]);
    session.duration = recorded[i].time.back();
  }
  if (!session.steered) add_trends(exercise, "");
  add_events(session.events, events, [&](double time) -> std::string {
    for (std::size_t i = recorded.size(); i-- > 0;)
      if (recorded.size() > 1 && time >= recorded[i].time.front()) return fmt::format("repetition {}", i + 1);
    return "";
  });
  add_warnings(session.events, header, "");
  session.touches = touch_figures(reader);
  session.exercises.push_back(std::move(exercise));
  return session;
}

// A session of a programme.

/// Numbers paths by their shape and duration: equal paths have equal numbers, whatever their files are called.
class Tasks {
 public:
  std::size_t number_of(const Path& path) {
    const auto found = std::find_if(known_.begin(), known_.end(), [&](const Curve& curve) {
      constexpr double kSamePlace = 1e-9, kSameTime = 1e-6;  // [m], [s]
      return std::abs(curve.duration - path.duration()) <= kSameTime &&
             std::equal(curve.position.begin(), curve.position.end(), path.position.begin(), path.position.end(),
                        [](const Vec3& a, const Vec3& b) { return (a - b).norm() <= kSamePlace; });
    });
    const auto number = static_cast<std::size_t>(found - known_.begin());
    if (found == known_.end()) known_.push_back({path.position, path.duration()});
    return number;
  }

 private:
  struct Curve {
    std::vector<Vec3> position;
    double duration = 0;  ///< [s]
  };
  std::vector<Curve> known_;
};

std::string places_in_words(const ReachTask& task) {
  if (task.goal == ReachGoal::weigh) return "";
  if (task.goal != ReachGoal::track)
    return fmt::format("{} {}", task.targets.size(), task.goal == ReachGoal::target ? "targets" : "directions");
  return fmt::format("a target that moves up to {:.4g} mm to both sides, with {:g} Hz",
                     1e3 * (task.targets.front() - task.start).norm(), fmt::join(task.track.frequency, ", "));
}

std::string path_in_words(const Programme& programme, const Exercise& exercise) {
  std::string text = exercise.path;
  if (exercise.reach) text = places_in_words(*exercise.reach);
  if (exercise.sense)
    text = fmt::format("pairs of places that differ by {:.4g} to {:.4g} mm", 1e3 * exercise.sense->differences.front(),
                       1e3 * exercise.sense->differences.back());
  if (exercise.shape) {
    text = exercise.shape->value("kind", std::string("shape"));
    if (const auto size = number_in(*exercise.shape, "size")) text += fmt::format(", {:.4g} mm", 1e3 * *size);
  }
  for (const PathChange& change : {exercise.change, programme.person}) {
    if (const std::string changes = describe(change); !changes.empty()) text += ", " + changes;
  }
  return text;
}

/// Adds the logged settings that the mode of the exercise uses.
void add_settings(ReportTrial& trial, const TrialSettings& settings, const Exercise& exercise) {
  using enum ExerciseMode;
  const ExerciseMode mode = exercise.mode;
  trial.support = settings.support;
  if (mode == passive || mode == assisted || mode == cursor) trial.pace = settings.pace;
  if (exercise.sense) return;
  if (mode != passive && mode != free && !exercise.reach) trial.radius = settings.radius;
  if (mode != passive && mode != free) trial.stiffness = settings.stiffness;
  if (mode == assisted) trial.assistance = settings.assistance;
  if (exercise.progression && exercise.progression->difficulty) trial.level = settings.level;
}

/// Returns a text that is the same for tests of position sense that compare.
std::string key_of(const SenseTask& task) {
  return fmt::format("{:g} m; {:g} s; {:g} s; ({:.4g}, {:.4g}, {:.4g})", task.reference, task.move, task.stay,
                     task.axis.x(), task.axis.y(), task.axis.z());
}

/// Returns a text that is the same for tasks with a cue that compare: field, clamp, blocks, and what sets their
/// metrics.
std::string key_of(const ReachTask& task) {
  std::string text = task.goal == ReachGoal::target ? "" : fmt::format("{}; ", to_string(task.goal));
  if (task.goal == ReachGoal::range) text += fmt::format("{:g}; ", task.target_hold);
  if (task.goal == ReachGoal::press) text += fmt::format("{}; ", task.locked);
  if (task.goal == ReachGoal::track) {
    text += fmt::format("{:g}; ", task.track.discard);
    for (const auto* values : {&task.track.frequency, &task.track.phase})
      text += fmt::format("{:g}; ", fmt::join(*values, " "));
  }
  if (task.field)
    for (const double entry : task.field->reshaped()) text += fmt::format("{:g} ", entry);
  text += fmt::format("; {:g} {:g} {:g}", task.clamp.stiffness.value_or(0), task.clamp.damping, task.clamp.break_out);
  for (const ReachBlock& block : task.blocks)
    text += fmt::format("; {} {} {:g} {:g}", block.reaches, block.field, block.clamps, block.catches);
  return text;
}

std::string place_of(const ReportSession& session, const LoggedTrial& trial) {
  std::string text = fmt::format("{}, repetition {}", session.exercises[trial.exercise].name, trial.repetition);
  if (trial.round > 1) text += fmt::format(", round {}", trial.round);
  if (trial.attempt > 1) text += fmt::format(", attempt {}", trial.attempt);
  return text;
}

/// Gathers the session of a programme that `where` names.
class SessionReading {
 public:
  SessionReading(const std::string& where, Tasks& tasks)
      : tasks_(tasks),
        folder_(fs::is_directory(where) ? fs::path(where) : fs::path(where).parent_path()),
        log_(load_session_log(where)),
        programme_(programme_from_json(log_.programme, where)),
        paths_(programme_.size()),
        scales_(programme_.size(), 1) {
    session_.source = where;
  }

  /// Reads the session. `progress` gets each recording and the share that was read before.
  ReportSession read(const std::function<void(const std::string&, double)>& progress) {
    fill_head();
    for (std::size_t i = 0; i < programme_.size(); ++i) add_exercise(i);
    for (const LoggedTrial& trial : log_.trials) {
      if (progress) progress(file(trial.file), static_cast<double>(&trial - log_.trials.data()) / trials());
      add_trial(trial);
    }
    for (std::size_t i = 0; i < programme_.size(); ++i) {
      ReportExercise& exercise = session_.exercises[i];
      const Exercise& asked = programme_.exercise(i);
      add_path(exercise, paths_[i], scales_[i]);
      exercise.blocks = summarise_blocks(programme_, i, log_);
      exercise.assessment = summarise_assessment(programme_, i, log_);
      exercise.sense = summarise_sense(programme_, i, log_);
      if (asked.reach) exercise.reach = key_of(*asked.reach);
      if (asked.sense) exercise.reach = key_of(*asked.sense);
      if (!session_.steered) add_trends(exercise, asked.progression ? asked.progression->figure : "");
    }
    return std::move(session_);
  }

 private:
  [[nodiscard]] std::string file(const std::string& name) const { return (folder_ / name).string(); }
  [[nodiscard]] double trials() const { return static_cast<double>(log_.trials.size()); }

  void fill_head() {
    session_.title = programme_.title.empty() ? folder_.filename().string() : programme_.title;
    session_.subject = log_.subject;
    session_.operator_name = log_.operator_name;
    session_.notes = log_.notes;
    session_.created = log_.created;
    session_.software = log_.software;
    session_.device = in_words(log_.device.model, log_.device.serial);
    session_.complete = log_.complete;
    session_.sittings = log_.sittings;
    session_.settings = log_.programme;
    for (const Sitting& sitting : log_.sittings) {
      session_.duration += sitting.duration;
      if (sitting.ended_by == "complete") continue;
      session_.events.push_back({.kind = ReportEvent::Kind::stop,
                                 .where = fmt::format("sitting {}", &sitting - log_.sittings.data() + 1),
                                 .text = sitting.ended_by.empty() ? "the log does not say how it ended"
                                                                  : in_words(sitting.ended_by, sitting.detail)});
    }
    if (std::any_of(log_.trials.begin(), log_.trials.end(),
                    [](const LoggedTrial& trial) { return !trial.input.empty(); }))
      mark_steered(session_);
    if (!log_.complete) session_.remarks.emplace_back("the programme was not completed");
    if (log_.trials.empty()) session_.remarks.emplace_back("no repetition was started");
    const std::string profile = file(kSessionProfile);
    if (!fs::exists(profile)) return;
    try {
      plant_ = load_profile(profile).plant;
    } catch (const Error& error) {
      session_.remarks.emplace_back(error.what());
    }
  }

  void add_exercise(std::size_t i) {
    const Exercise& exercise = programme_.exercise(i);
    const bool test = exercise.test != TestLabel::none;
    session_.exercises.push_back({.name = exercise.name,
                                  .mode = to_string(exercise.mode),
                                  .test = test ? to_string(exercise.test) : "",
                                  .warm_up = i < programme_.warm_up.size(),
                                  .path = path_in_words(programme_, exercise)});
    // Scale of the expert's force as the participant should feel it.
    const bool guided = exercise.mode != ExerciseMode::passive && exercise.mode != ExerciseMode::free &&
                        !exercise.reach && !exercise.sense;
    scales_[i] = guided ? exercise.force_scale : 0;
    try {
      const Path path = load_path(file(log_.paths[i]));
      paths_[i].emplace(path_of(path));
      session_.exercises.back().task = tasks_.number_of(path);
    } catch (const Error& error) {
      session_.remarks.push_back(fmt::format("the path of {} cannot be shown{}: {}", exercise.name,
                                             test ? ", and its tests cannot be compared" : "", error.what()));
    }
  }

  void add_trial(const LoggedTrial& logged) {
    ReportExercise& exercise = session_.exercises[logged.exercise];
    ReportTrial trial{.round = logged.round,
                      .repetition = logged.repetition,
                      .attempt = logged.attempt,
                      .began = logged.began,
                      .file = logged.file,
                      .stopped_by = logged.stopped_by,
                      .detail = logged.detail,
                      .duration = logged.duration,
                      .figures = values_of(logged.figures)};
    add_settings(trial, logged.settings, programme_.exercise(logged.exercise));
    if (logged.reach) trial.target = describe(*programme_.exercise(logged.exercise).reach, *logged.reach);
    trial.at_limit = logged.figures.is_object() && logged.figures.contains("at_limit");
    if (logged.sense) trial.answer = logged.sense->answer;
    const std::string place = place_of(session_, logged);
    const std::size_t first = session_.events.size();
    if (!trial.finished() && !trial.out_of_time()) tell_end(trial, place);
    for (const std::string& notice : logged.notices) session_.events.push_back({.where = place, .text = notice});
    try {
      add_recording(trial, exercise, logged, place);
    } catch (const Error& error) {
      trial.missing = error.what();
      if (!logged.figures.is_null() && !has_present_definitions(logged.figures)) {
        trial.figures.assign(all_trial_figures().size(), std::nullopt);
        session_.remarks.push_back(
            fmt::format("the metrics of {} have the definitions of an older version; without the "
                        "recording they are left out",
                        place));
      }
      session_.remarks.push_back(fmt::format("the recording of {} cannot be shown: {}", place, error.what()));
    }
    // A recording contains the event of its end. If it is missing, the log provides one.
    if (trial.out_of_time() &&
        std::none_of(session_.events.begin() + static_cast<std::ptrdiff_t>(first), session_.events.end(),
                     [](const ReportEvent& event) { return event.kind == ReportEvent::Kind::stop; }))
      tell_end(trial, place);
    exercise.trials.push_back(std::move(trial));
  }

  void tell_end(const ReportTrial& trial, const std::string& place) {
    session_.events.push_back({.kind = ReportEvent::Kind::stop,
                               .where = place,
                               .text = trial.stopped_by.empty() ? "the log does not say how it ended"
                                                                : in_words(trial.end_in_words(), trial.detail)});
  }

  void add_recording(ReportTrial& trial, ReportExercise& exercise, const LoggedTrial& logged,
                     const std::string& place) {
    const std::string name = file(logged.file);
    const RecordingReader reader(name);
    add_events(session_.events, reader.events(), [&](double) { return place; });
    const std::vector<RecordedTrial> runs = read_trials(reader, name);
    if (runs.empty()) throw input_error(name + ": contains no repetition");
    const RecordedTrial& run = runs.back();
    std::optional<DrawnPath>& path = paths_[logged.exercise];
    if (!path)
      if (std::optional<TrialPath> own = path_of(run)) path.emplace(std::move(*own));
    add_device(reader.header());
    // An old log has metrics of other definitions, and an incomplete one has none.
    trial.figures = add_recorded(trial, run, path, plant_,
                                 (trial.finished() || trial.out_of_time()) && !has_present_definitions(logged.figures));
    add_tunnel(exercise, run);
  }

  /// Adds facts that only the recordings have.
  void add_device(const RecordingHeader& header) {
    session_.device_force = std::max(session_.device_force, header.max_force_n);
    if (!session_.force_limit) session_.force_limit = force_limit_of(header);
    session_.meta.insert(header.meta.begin(), header.meta.end());
  }

  Tasks& tasks_;
  fs::path folder_;
  SessionLog log_;
  Programme programme_;
  std::vector<std::optional<DrawnPath>> paths_;  ///< by exercise
  std::vector<double> scales_;                   ///< factors on the expert's force, by exercise
  std::optional<PlantModel> plant_;
  ReportSession session_;
};

// Tests.

constexpr std::array kTests{"before", "after", "retention"};

std::vector<ReportComparison> compare(const std::vector<ReportSession>& sessions) {
  std::vector<ReportComparison> comparisons;
  // A participant without a name may be a different one in another session.
  std::map<std::tuple<std::string, std::optional<std::size_t>, std::size_t>, std::size_t> known;
  for (const char* test : kTests)
    for (std::size_t s = 0; s < sessions.size(); ++s)
      for (const ReportExercise& exercise : sessions[s].exercises) {
        if (exercise.test != test || exercise.warm_up || !exercise.task || sessions[s].steered) continue;
        const std::string& subject = sessions[s].subject;
        const std::optional<std::size_t> only = subject.empty() ? std::optional(s) : std::nullopt;
        const auto [found, added] = known.try_emplace({subject, only, *exercise.task}, comparisons.size());
        if (added) comparisons.push_back({.subject = subject, .task = exercise.path, .session = only, .groups = {}});
        std::vector<ReportSummary> summaries;
        for (std::size_t i = 0; i < all_trial_figures().size(); ++i) summaries.push_back(summary_of(exercise, i));
        comparisons[found->second].groups.push_back(
            {.test = test,
             .session = s,
             .exercise = static_cast<std::size_t>(&exercise - sessions[s].exercises.data()),
             .summaries = std::move(summaries)});
      }
  std::erase_if(comparisons, [](const ReportComparison& comparison) { return comparison.groups.size() < 2; });
  return comparisons;
}

// Files.

/// Returns the absolute name of a file with links resolved; the file need not exist.
std::string canonical_name(const fs::path& file) {
  std::error_code failed;
  const fs::path absolute = fs::absolute(file, failed), canonical = fs::weakly_canonical(absolute, failed);
  return (failed ? absolute : canonical).string();
}

/// Returns the file that identifies an input.
fs::path main_file(const std::string& input) {
  return is_session(input) && fs::is_directory(input) ? fs::path(input) / kSessionFile : fs::path(input);
}

void add_recording_files(std::set<std::string>& files, const fs::path& recording) {
  files.insert(canonical_name(recording));
  for (std::uint32_t part = 2; fs::exists(part_file(recording.string(), part)); ++part)
    files.insert(canonical_name(part_file(recording.string(), part)));
}

/// Returns all files from which a report is made, whether they exist or not.
std::set<std::string> files_of(std::span<const std::string> inputs) {
  std::set<std::string> files;
  for (const std::string& input : inputs) {
    if (!is_session(input)) {
      add_recording_files(files, input);
      continue;
    }
    const fs::path log_file = main_file(input), folder = log_file.parent_path();
    const SessionLog log = load_session_log(input);
    for (const fs::path& file : {log_file, folder / kSessionProfile}) files.insert(canonical_name(file));
    for (const std::string& path : log.paths) files.insert(canonical_name(folder / path));
    for (const LoggedTrial& trial : log.trials) add_recording_files(files, folder / trial.file);
  }
  return files;
}

}  // namespace

std::string ReportTrial::end_in_words() const {
  if (finished()) return "finished";
  if (answer == 0 && out_of_time()) return "no answer";
  if (out_of_time()) {
    static const std::size_t kCompletion = index_of("completion");
    const std::optional<double> share = kCompletion < figures.size() ? figures[kCompletion] : std::nullopt;
    return share ? fmt::format("ran out of time at {:.0f} % of the path", 100 * *share) : "ran out of time";
  }
  if (stopped_by.empty()) return "unknown";
  std::string words = stopped_by;
  std::replace(words.begin(), words.end(), '_', ' ');
  return words;
}

std::size_t ReportExercise::finished() const {
  return static_cast<std::size_t>(
      std::count_if(trials.begin(), trials.end(), [](const ReportTrial& trial) { return trial.finished(); }));
}

std::size_t ReportExercise::out_of_time() const {
  return static_cast<std::size_t>(
      std::count_if(trials.begin(), trials.end(), [](const ReportTrial& trial) { return trial.out_of_time(); }));
}

Report gather_report(std::span<const std::string> inputs,
                     const std::function<void(const std::string& file, double done)>& progress) {
  Report report;
  Tasks tasks;
  std::set<std::string> known;
  for (const std::string& input : inputs) {
    const auto tell = [&](const std::string& file, double share) {
      const double before = static_cast<double>(&input - inputs.data());
      if (progress) progress(file, (before + share) / static_cast<double>(inputs.size()));
    };
    if (!known.insert(canonical_name(main_file(input))).second) continue;
    tell(input, 0);
    if (fs::is_directory(input) && !is_session(input))
      throw input_error(
          fmt::format("{}: contains no {}; give the folder of a session, or a recording (HDF5)", input, kSessionFile));
    report.sessions.push_back(is_session(input) ? SessionReading(input, tasks).read(tell)
                                                : session_of_recording(input));
  }
  // Times are in UTC, so that their texts sort by time.
  std::stable_sort(report.sessions.begin(), report.sessions.end(),
                   [](const ReportSession& a, const ReportSession& b) { return a.created < b.created; });
  report.comparisons = compare(report.sessions);
  report.persons = persons_of(report.sessions);
  return report;
}

void check_report_outputs(std::span<const std::string> outputs, std::span<const std::string> inputs) {
  const std::set<std::string> files = files_of(inputs);
  std::set<std::string> known;
  for (const std::string& output : outputs) {
    const std::string name = canonical_name(output);
    if (files.contains(name) || is_session(name))
      throw input_error(output + ": belongs to the recorded data, which a report never replaces; choose another name");
    if (!known.insert(name).second)
      throw input_error(output + ": would be both the page and the table; choose another name for one of them");
  }
}

}  // namespace haptrace
