// A programme of trajectories: what a person is to do with a device, exercise after exercise, and how it adapts.
#pragma once

#include "control/path/path.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// What the device does during an exercise.
enum class ExerciseMode {
  passive,   ///< it moves the person along the path
  assisted,  ///< it helps along the path and towards it, no more than is needed
  tunnel,    ///< it keeps the person in a tunnel round the path
  cursor,    ///< it pulls towards a place that moves along the path
  resist,    ///< it resists along the path, within a tunnel
  free,      ///< nothing
};

const char* to_string(ExerciseMode mode);

/// A test is a trial that is compared with others of the same label: before the lesson, after it, days later.
enum class TestLabel { none, before, after, retention };

const char* to_string(TestLabel label);

/// From what is easy for a person to what is hard.
struct DifficultyRange {
  double easy = 0, hard = 0;

  /// Geometrically between the two, at level 0 to 1.
  [[nodiscard]] double at(double level) const;
};

/// How an exercise adapts to how its last repetitions went. See player/programme/progression.h for the laws.
struct Progression {
  std::string figure = "contour_rms_m";  ///< of metrics/recorded_trial.h
  double target = 0;                     ///< of that figure; what is as good, or better, is good enough
  double tolerance = 0.5;                ///< share of the target, beyond which a repetition has failed
  int window = 3;                        ///< repetitions that the difficulty goes by

  /// Assistance as needed: 0 none, 1 all.
  struct Assistance {
    double start = 1, forget = 0.8, gain = 0.5;
  };
  std::optional<Assistance> assistance;

  struct Difficulty {
    double start = 0, step = 0.2;                            ///< level, 0 to 1
    std::optional<DifficultyRange> radius, stiffness, pace;  ///< [m], [N/m], times the path's own
  };
  std::optional<Difficulty> difficulty;
};

/// Of a path: mirrored in a plane through the origin of W, then scaled about it.
struct PathChange {
  std::optional<int> mirror;  ///< axis that changes its sign
  double scale = 1;

  /// Positions and velocities; forces are mirrored and not scaled.
  void apply(Path& path) const;
};

/// One exercise: repetitions of one path.
struct Exercise {
  std::string name;
  std::string path;                     ///< a file, from the folder of the programme; or
  std::optional<nlohmann::json> shape;  ///< a shape and its options
  PathChange change;
  ExerciseMode mode = ExerciseMode::tunnel;
  TestLabel test = TestLabel::none;
  int repetitions = 1;
  double rest = 2;                  ///< after each of them [s]
  double rest_after = 0;            ///< after the last, besides [s]
  double hold = 0.5;                ///< at the end of each [s]
  double pace = 1;                  ///< of passive, assisted and cursor, times the path's own
  double time_limit = 0;            ///< of a repetition [s]; 0: five times the path's and 10 s
  double radius = 5e-3;             ///< of the tunnel [m]
  std::optional<double> stiffness;  ///< [N/m]; as stiff as the device bears when absent
  double assist_force = 2;          ///< help along the path, at most [N]
  double resistance = 0;            ///< along the path [N s/m]
  double viscosity = 0;             ///< against all movement [N s/m]
  double force_scale = 1;           ///< of the expert's forces, where the path has any
  bool resist_forces = false;       ///< the person is to bring them up, see Feel
  double wait = 0;                  ///< distance at which a cursor waits [m]; 0: it does not
  bool allow_back = false;
  std::optional<Progression> progression;
};

/// When a sitting ends before the programme does. 0: no limit.
struct ProgrammeLimits {
  double time = 0;        ///< of the sitting, rests included [s]
  double force_dose = 0;  ///< integral of the magnitude of the force [N s]

  /// Repetitions in a row of an exercise that were worse than its best in this sitting.
  struct Fatigue {
    std::string figure = "movement_time_s";
    double worse = 0.3;  ///< by this share of the best
    int repetitions = 3;
  };
  std::optional<Fatigue> fatigue;
};

struct Programme {
  std::string title, description;
  PathChange person;  ///< of every path, after the exercise's own
  ProgrammeLimits limits;
  int rounds = 1;                 ///< times that the exercises are gone through
  std::vector<Exercise> warm_up;  ///< once, before them; in no comparison
  std::vector<Exercise> exercises;

  /// Warm-up first, as trials number them.
  [[nodiscard]] std::size_t size() const noexcept { return warm_up.size() + exercises.size(); }
  [[nodiscard]] const Exercise& exercise(std::size_t i) const {
    return i < warm_up.size() ? warm_up[i] : exercises[i - warm_up.size()];
  }
};

/// Throws Error(input) naming `where` and the path of the key: unknown, missing, of another type, out of its range, or
/// without meaning in the exercise's mode. Keys and ranges are those of programme.schema.json.
Programme programme_from_json(const nlohmann::json& json, const std::string& where);

/// The path of an exercise, as a person is to follow it. `folder`: what files are looked for in. Throws Error(input).
Path path_of(const Programme& programme, const Exercise& exercise, const std::string& folder);

}  // namespace haptrace
