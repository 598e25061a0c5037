// Sessions for the tests of reports, with recordings of known hand movements.
#pragma once

#include "control/path/min_jerk.h"
#include "control/path/shapes.h"
#include "formats/documents/session_log.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"
#include "metrics/recorded_trial.h"
#include "tests/support/temp_folder.h"

#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <numbers>

namespace haptrace::test {

/// A hand's movement along a path.
struct Hand {
  double error = 2e-3;  ///< Amplitude of waves across the path [m].
  double speed = 1;     ///< Speed relative to the path's own.
  double until = 1;     ///< Share of the duration after which the hand stops.
  double rate_hz = 250;
  double tremor = 0;     ///< Amplitude of a tremor at 7 Hz [m].
  double radius = 5e-3;  ///< Radius of the recorded tunnel [m].
};

/// Data that is recorded beside position and force.
enum class Reference { none, playback, guidance };

/// Returns a circle of 80 mm in 4 s with an expert's forces.
inline Path expert_path() {
  Path path = make_shape("circle", {.duration = 4});
  path.name = "circle";
  for (const double t : path.time) path.force.emplace_back(0.8 * std::cos(1.5 * t), 1.2, 0.3 * std::sin(t));
  return path;
}

/// Returns the rows of one repetition: half a second of approach, then the run.
inline std::vector<Sample> rows_of(const Path& path, const Hand& hand, Reference reference, std::int64_t begin_ns = 0,
                                   std::uint64_t tick = 0) {
  const TrialPath curve = path_of(path);
  const double length = curve.curve.length(), duration = path.duration() / hand.speed;
  const auto approach = static_cast<std::size_t>(0.5 * hand.rate_hz);
  const auto run = static_cast<std::size_t>(duration * hand.until * hand.rate_hz);
  std::vector<Sample> rows;
  for (std::size_t i = 0; i < approach + run; ++i) {
    const double t = i < approach ? 0 : static_cast<double>(i - approach) / hand.rate_hz;
    const double arc = length * MinJerk::at(t / duration).s;
    const Vec3 place = curve.curve.at(arc);
    const double wave = 2 * std::numbers::pi * arc / length;
    Sample row{.tick = tick + i,
               .time_ns = begin_ns + static_cast<std::int64_t>(1e9 * static_cast<double>(i) / hand.rate_hz),
               .position = place + hand.error * Vec3(std::sin(3 * wave), std::cos(2 * wave) - 1, std::sin(wave)) +
                           hand.tremor * std::sin(2 * std::numbers::pi * 7 * t) * Vec3(0.7, 0.7, 0),
               .phase = i < approach ? Phase::approach : Phase::run};
    row.velocity = Vec3::Zero();
    row.force = Vec3(0.8 * std::cos(wave), 1.0, 0.2) + 60 * (place - row.position);
    if (reference != Reference::none) {
      row.reference_position = place;
      row.reference_velocity = Vec3::Zero();
    }
    if (reference == Reference::guidance) {
      row.progress = arc;
      row.reference_force =
          curve.expert.empty()
              ? Vec3(Vec3::Zero())
              : curve.expert[std::min(static_cast<std::size_t>(arc / curve.spacing), curve.expert.size() - 1)];
      row.tunnel_radius = hand.radius;
    }
    rows.push_back(row);
  }
  return rows;
}

inline RecordingColumns columns_of(Reference reference) {
  return {.reference = reference != Reference::none,
          .guidance = reference == Reference::guidance,
          .tunnel = reference == Reference::guidance};
}

struct Recorded {
  RecordingHeader header;
  std::vector<StoredEvent> events{{0, 1, "started"}, {1e6, 2, "finished"}};
  bool finish = true;
  bool supported = false;  ///< the arm: the rows have that force
};

/// Writes rows as a recording. Without `finish`, the file is left as by a killed process.
inline void write(const std::string& file, const std::vector<Sample>& rows, Reference reference,
                  const Recorded& recorded = {}) {
  RecordingColumns columns = columns_of(reference);
  columns.support = recorded.supported;
  RecordingWriter writer(file, recorded.header, columns, {});
  writer.append(rows);
  for (const StoredEvent& event : recorded.events) writer.append(event);
  if (recorded.finish)
    writer.finish();
  else
    writer.abandon();
}

/// A session of a programme in a folder. Recordings are written and metrics computed as in a real session.
class SessionFolder {
 public:
  explicit SessionFolder(const std::string& path) : path_(path) {
    std::filesystem::create_directories(std::filesystem::path(path) / "paths");
    log.created = "2026-03-04T09:30:00Z";
    log.software = "haptrace 0.1.0";
    log.subject = "Ada L.";
    log.operator_name = "B. Therapist";
    log.device = {"sim", "Novint Falcon", "7"};
    log.programme = {
        {"haptrace_programme", 1}, {"title", "Circles, first lesson"}, {"exercises", nlohmann::json::array()}};
  }

  /// Adds an exercise on the circle, with the further keys `more`, and returns its index.
  std::size_t exercise(const std::string& name, const std::string& mode,
                       nlohmann::json more = nlohmann::json::object()) {
    const std::size_t i = log.programme["exercises"].size();
    more["name"] = name;
    more["mode"] = mode;
    more["shape"] = {{"kind", "circle"}, {"duration", 4}};
    log.programme["exercises"].push_back(std::move(more));
    log.paths.push_back(fmt::format("paths/{:02}.h5", i + 1));
    save_path(expert, file(log.paths.back()), name, false);
    return i;
  }

  /// Records and logs a repetition of an exercise. Returns its log entry.
  LoggedTrial& trial(std::size_t exercise, const Hand& hand, const std::string& stopped_by = "finished") {
    const std::string mode = log.programme["exercises"][exercise]["mode"];
    const Reference reference = mode == "free"      ? Reference::none
                                : mode == "passive" ? Reference::playback
                                                    : Reference::guidance;
    int repetition = 1;
    for (const LoggedTrial& other : log.trials) repetition += other.exercise == exercise ? 1 : 0;
    LoggedTrial trial{.exercise = exercise, .repetition = repetition};
    trial.settings = {.radius = hand.radius, .stiffness = 650};
    trial.file = fmt::format("trials/{:02}-{:03}.h5", exercise + 1, repetition);
    trial.began = "2026-03-04T09:31:00Z";
    trial.stopped_by = stopped_by;
    std::filesystem::create_directories(file("trials"));
    const std::vector<Sample> rows = rows_of(expert, hand, reference);
    write(file(trial.file), rows, reference);
    trial.duration = 1e-9 * static_cast<double>(rows.back().time_ns);
    if (trial.finished())
      trial.figures =
          to_json(trial_figures(read_trials(RecordingReader(file(trial.file)), trial.file).back(), path_of(expert)));
    log.trials.push_back(std::move(trial));
    return log.trials.back();
  }

  [[nodiscard]] std::string file(const std::string& name) const { return path_ + "/" + name; }
  [[nodiscard]] const std::string& path() const { return path_; }
  void save() const { save_session_log(log, path_); }

  SessionLog log;
  Path expert = expert_path();

 private:
  std::string path_;
};

/// Writes a session with tests before and after, a passive exercise, and a tunnel exercise whose repetitions improve.
/// One repetition in the tunnel is stopped.
inline void write_lesson(SessionFolder& session, int repetitions = 8) {
  const std::size_t before = session.exercise("Circle alone, before", "free", {{"test", "before"}, {"repetitions", 3}});
  const std::size_t shown = session.exercise("Circle shown", "passive", {{"repetitions", 2}});
  const std::size_t tunnel =
      session.exercise("Circle in the tunnel", "tunnel", {{"repetitions", repetitions}, {"radius", 5e-3}});
  const std::size_t after = session.exercise("Circle alone, after", "free", {{"test", "after"}, {"repetitions", 3}});
  for (int i = 0; i < 3; ++i) session.trial(before, {.error = 6e-3 - 4e-4 * i, .speed = 0.6, .tremor = 4e-4});
  for (int i = 0; i < 2; ++i) session.trial(shown, {.error = 8e-4});
  for (int i = 0; i < repetitions; ++i) {
    const double n = i + 1, wobble = 3e-4 * std::sin(7.0 * n);
    if (i == 4) {
      LoggedTrial& stopped = session.trial(tunnel, {.error = 3e-3, .until = 0.55}, "deviation");
      stopped.detail = "the hand was 0.104 m from the path, farther than 0.1 m";
      continue;
    }
    LoggedTrial& trial =
        session.trial(tunnel, {.error = 1.2e-3 + 3.5e-3 / n + wobble, .speed = 0.6 + 0.04 * n, .tremor = 3e-4 / n});
    if (i == 2) trial.notices = {"the motors warm up: 82 % of what they bear"};
  }
  for (int i = 0; i < 3; ++i) session.trial(after, {.error = 3.2e-3 - 2e-4 * i, .speed = 0.9, .tremor = 1e-4});
  session.log.sittings.push_back({.began = "2026-03-04T09:30:00Z",
                                  .ended = "2026-03-04T09:41:00Z",
                                  .ended_by = "complete",
                                  .duration = 655,
                                  .force_dose = 210});
  session.log.complete = true;
  session.save();
}

}  // namespace haptrace::test
