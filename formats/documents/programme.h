// Programme of exercises for a participant on a device: trajectories, modes, and adaptation.
#pragma once

#include "control/guidance_options.h"
#include "control/path/path_change.h"
#include "formats/documents/expert_recording.h"
#include "formats/documents/reach_task.h"
#include "formats/documents/sense_task.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Behaviour of the device during an exercise.
enum class ExerciseMode {
  passive,   ///< moves the participant along the path
  assisted,  ///< helps along the path and towards it, only as much as needed
  tunnel,    ///< keeps the participant in a tunnel around the path
  cursor,    ///< pulls towards a point that moves along the path
  resist,    ///< resists along the path, within a tunnel
  free,      ///< does nothing
  // With a cue (ReachTask):
  reach,  ///< leaves the participant to reach for targets, within force fields and channels
  range,  ///< leaves the participant to move as far as they can
  press,  ///< holds the hand while the participant presses as hard as they can
  track,  ///< leaves the participant to follow a moving target
  weigh,  ///< holds the hand while the participant rests the arm on the device
  // With an answer:
  sense,  ///< moves the hand to two places, of which the participant names the farther one (SenseTask)
};

const char* to_string(ExerciseMode mode);
std::vector<std::string> exercise_modes();  ///< names of all modes

/// A test is a trial that is compared with others of the same label: before training, after it, or days later.
enum class TestLabel { none, before, after, retention };

const char* to_string(TestLabel label);

/// Range of a setting from easy to hard.
struct DifficultyRange {
  double easy = 0, hard = 0;

  /// Interpolates geometrically between easy and hard, at level 0 to 1.
  [[nodiscard]] double at(double level) const;
};

/// Adaptation of an exercise to the results of its last repetitions. player/programme/progression.h states the laws.
struct Progression {
  std::string figure = "contour_rms_m";  ///< metric of metrics/recorded_trial.h
  double target = 0;                     ///< value of the metric that is good enough, as are better ones
  double tolerance = 0.5;                ///< share of the target; a repetition that misses it by more has failed
  int window = 3;                        ///< number of repetitions that set the difficulty

  /// Assistance as needed: 0 none, 1 full.
  struct Assistance {
    double start = 1, forget = 0.8, gain = 0.5;
  };
  std::optional<Assistance> assistance;

  struct Difficulty {
    double start = 0, step = 0.2;                            ///< level, 0 to 1
    std::optional<DifficultyRange> radius, stiffness, pace;  ///< [m], [N/m], relative to the path's own pace
  };
  std::optional<Difficulty> difficulty;
};

/// Order of the exercises within a round. player/programme/trial_order.h states how it is drawn.
enum class TrialOrder {
  listed,       ///< as in the file
  blocked,      ///< all repetitions of one exercise after another, the exercises in a random order
  interleaved,  ///< cycles of one repetition of each exercise, each in a random order
};

const char* to_string(TrialOrder order);

/// Share of the repetitions that show something to the trainee. It changes evenly from the first to the last
/// repetition.
struct ShownShare {
  double from = 1, to = 1;

  bool operator==(const ShownShare&) const = default;
};

/// Parts of a trainee's screen.
enum class ScreenPart { tool, path, tunnel, trail, score };
inline constexpr std::size_t kScreenParts = 5;

const char* to_string(ScreenPart part);

/// Shares by ScreenPart; absent: the default.
using ShownShares = std::array<std::optional<ShownShare>, kScreenParts>;

/// The parts of the screen that one repetition shows, by ScreenPart.
using ShownParts = std::array<bool, kScreenParts>;

/// The part of the arm's weight that the device carries, see ArmSupport.
struct ArmSupportTask {
  double force = 0;             ///< [N]
  std::optional<double> share;  ///< of the weight that mode weigh measured before; replaces `force`

  bool operator==(const ArmSupportTask&) const = default;
};

/// One exercise: repetitions of one path, or of an assessment that has a mode of its own. An assessment keeps its
/// settings in an object with the name of its mode, and its places in path_of().
struct Exercise {
  std::string name;
  std::string path;                     ///< a file, relative to the programme's folder; or
  std::optional<nlohmann::json> shape;  ///< a shape and its options; or
  std::optional<ReachTask> reach;       ///< targets, in a mode with a cue; or
  std::optional<SenseTask> sense;       ///< pairs of places, in mode sense
  PathChange change;
  ExerciseMode mode = ExerciseMode::tunnel;
  TestLabel test = TestLabel::none;
  int repetitions = 1;
  double rest = 2;        ///< pause after each repetition [s]
  double rest_after = 0;  ///< additional pause after the last repetition [s]
  double hold = 0.5;      ///< hold at the end of each repetition [s]
  double pace = 1;        ///< for passive, assisted and cursor, relative to the path's own pace
  /// Time limit of a repetition [s]; 0: five times the path's duration and 10 s. A reach always has one.
  double time_limit = 0;
  double radius = 5e-3;             ///< of the tunnel [m]
  bool states_radius = false;       ///< `radius` was given
  std::optional<double> stiffness;  ///< [N/m]; absent: the stiffest that is stable on the device
  double assist_force = 2;          ///< largest force that helps along the path [N]
  double resistance = 0;            ///< along the path [N s/m]
  double viscosity = 0;             ///< against all movement [N s/m]
  double force_scale = 1;           ///< factor on the expert's forces, if the path has any
  ExpertOptions expert;             ///< force of the path, if that is a recording
  /// Help for a participant who does not start, see BackWall; its pace follows from `pace`.
  std::optional<BackWallOptions> initiate;
  bool resist_forces = false;  ///< the participant produces the forces, see Feel
  double wait = 0;             ///< distance at which a cursor waits for the participant [m]; 0: it does not wait
  bool allow_back = false;
  bool catch_trial = false;  ///< its repetitions lie at random places between those of the other exercises
  std::optional<Progression> progression;
  std::optional<ArmSupportTask> support;  ///< absent: that of the programme
  ShownShares show;
};

/// Limits that end a sitting before the programme is complete. 0: no limit.
struct ProgrammeLimits {
  double time = 0;        ///< duration of the sitting, including rests [s]
  double force_dose = 0;  ///< integral of the force's magnitude [N s]

  /// Ends a sitting after consecutive repetitions of an exercise that are worse than its best in this sitting.
  struct Fatigue {
    std::string figure = "movement_time_s";
    double worse = 0.3;  ///< relative to the best
    int repetitions = 3;
  };
  std::optional<Fatigue> fatigue;
};

struct Programme {
  std::string title, description;
  PathChange person;  ///< applied to every path after the exercise's own change; has no frame
  ProgrammeLimits limits;
  std::optional<ArmSupportTask> support;  ///< of exercises that do not say otherwise
  Vec3 up = Vec3::UnitY();                ///< unit vector upwards, in W
  ShownShares show;                       ///< of exercises that do not say otherwise
  int rounds = 1;                         ///< number of passes through the exercises
  TrialOrder order = TrialOrder::listed;
  std::optional<std::uint64_t> seed;  ///< of a random order; begin_session() draws one if there is none
  std::vector<Exercise> warm_up;      ///< done once, before the exercises; excluded from comparisons
  std::vector<Exercise> exercises;

  /// Returns true if a seed decides the order of the repetitions or of their targets.
  [[nodiscard]] bool is_random() const noexcept;
  /// Returns the number of exercises. Trials number the warm-up first.
  [[nodiscard]] std::size_t size() const noexcept { return warm_up.size() + exercises.size(); }
  [[nodiscard]] const Exercise& exercise(std::size_t i) const {
    return i < warm_up.size() ? warm_up[i] : exercises[i - warm_up.size()];
  }
};

/// Reads a programme. Throws Error(input) naming `where` and the path of the key if a key is unknown, missing, of the
/// wrong type, out of range, or without meaning in the exercise's mode. programme.schema.json states keys and ranges.
Programme programme_from_json(const nlohmann::json& json, const std::string& where);

/// Returns the support of the arm in exercise `i`: its own or that of the programme, and none where the force of the
/// hand is measured (modes press and weigh).
ArmSupportTask support_of(const Programme& programme, std::size_t i);

/// Returns true if an exercise has a tunnel to show and to count. An exercise in mode free has one only if it states a
/// radius, or shows the tunnel or the score, which counts the time in it.
bool has_tunnel(const Exercise& exercise);

/// Returns the share of the repetitions of exercise `i` that show a part: its own, that of the programme, or all. Tests
/// and exercises in mode free show no tunnel, trail or score unless they say so themselves, because a test must not
/// train.
ShownShare shown_share(const Programme& programme, std::size_t i, ScreenPart part);

/// Returns what a repetition of exercise `i` shows. Repetitions count from 1 in every round; those of the warm-up have
/// one round. The repetitions that show a part are spread evenly, and the same ones in every run of the programme.
ShownParts shown_parts(const Programme& programme, std::size_t i, int round, int repetition);

/// Returns the path of an exercise for the participant. That of an exercise with a cue goes from the start to each
/// target and back, a second each: sample 0 is the start, and sample 2 k + 1 the target k. That of mode sense
/// goes from the start to the farthest place. Files are relative to `folder`. Throws Error(input).
Path path_of(const Programme& programme, const Exercise& exercise, const std::string& folder);

/// Returns the linear part of the changes of an exercise with a cue and its participant, without the scale.
Eigen::Matrix3d turn_of(const Programme& programme, const Exercise& exercise);

}  // namespace haptrace
