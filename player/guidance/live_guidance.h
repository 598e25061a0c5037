// Changes guidance while it runs by commands, within the limits of the device, and logs every change.
#pragma once

#include "control/guidance.h"
#include "player/tuning/live_session.h"

#include <cstddef>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

struct GuideOptions;
struct GuidePlan;

/// Quantities of guidance that commands change.
struct GuidanceValues {
  double radius = 0;     ///< of the tunnel [m], or the factor on a radius that varies along the path
  double stiffness = 0;  ///< of the walls at full assistance [N/m]
  double force = 1;      ///< factor on the expert's force
  double assist = 1;     ///< share of the help, 0 to 1; in an assisted exercise of the walls too
  double damping = 0;    ///< of outward movement in the walls [N s/m]

  bool operator==(const GuidanceValues&) const = default;
};

/// The commands that change running guidance, and those of every session (LiveSession):
///
///     radius 6mm    stiffness 400    force 0.5    assist 0.8    damping 2    radius * 1.1    stiffness / 1.1
///
/// One object can serve many sessions one after the other, as in a programme: a changed value holds for later
/// repetitions of the same exercise too.
class LiveGuidance final : public LiveSession {
 public:
  /// Guidance of one session, as its terms were composed.
  struct Scope {
    GuidanceValues start;       ///< values without commands
    GuidanceValues composed;    ///< values with which the terms were composed
    bool varies = false;        ///< the radius varies along the path, and `radius` is a factor on it
    double largest_radius = 1;  ///< [m]
    double largest_stiffness = 0;
    std::string because;        ///< its name, as in "stability limit of this device"
    bool walls = true;          ///< the session has walls, ...
    bool expert_force = false;  ///< ... the expert's force, ...
    bool help = false;          ///< ... help along the path, which `assist` scales, ...
    bool walls_help = false;    ///< ... and `assist` scales the walls too
    bool adapts = false;        ///< `assist` alone acts, on the next repetition: the present one has no forces
    std::string without;        ///< remedy in the error about a missing part, after a semicolon
  };

  explicit LiveGuidance(Options options) : LiveSession(std::move(options)) {}

  /// Begins a session. `exercise` identifies the values that earlier commands changed.
  void begin(Scope scope, std::size_t exercise = 0);
  /// Begins a session without guidance, such as a passive exercise.
  void begin_unguided(std::string name);

  /// Returns the values of the next repetition of an exercise: `start`, or what commands set.
  [[nodiscard]] GuidanceValues next(std::size_t exercise, const GuidanceValues& start) const;
  /// Returns the requested values. mailbox() holds the newest ones, relative to those composed, for the servo loop.
  [[nodiscard]] GuidanceValues wanted() const;
  [[nodiscard]] Mailbox<GuideTuning>& mailbox() noexcept { return mailbox_; }

 private:
  /// Values that commands set in an exercise.
  struct Changed {
    std::optional<double> radius, stiffness, force, assist, damping;
  };
  struct Quantity;
  static const std::vector<Quantity>& all();
  /// Throws Error(input) unless the session has the quantity.
  [[nodiscard]] const Quantity& quantity(const std::string& name) const;
  [[nodiscard]] std::string missing(const Quantity& quantity) const;
  [[nodiscard]] double parsed(const Quantity& quantity, Words values) const;
  [[nodiscard]] std::string value_text(const Quantity& quantity, double value) const;
  void post();
  /// Replaces values by those that commands set in an exercise. Needs the mutex.
  void change_as_asked(GuidanceValues& values, std::size_t exercise) const;

  [[nodiscard]] const std::vector<std::string>& quantities() const override;
  [[nodiscard]] std::string help() const override;
  std::string change(const std::string& name, Words values) override;
  std::string reset() override;
  [[nodiscard]] std::string text_of(const std::string& name) const override;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::vector<LiveControl> list_controls() const override;
  [[nodiscard]] std::string summarise() const override;

  std::optional<Scope> scope_;
  std::string unguided_;  ///< why there is no scope
  std::size_t exercise_ = 0;
  GuidanceValues wanted_;
  std::map<std::size_t, Changed> changed_;
  Mailbox<GuideTuning> mailbox_;
};

/// Returns what commands can change of guidance that runs `plan`.
LiveGuidance::Scope guide_scope(const GuidePlan& plan, const GuideOptions& options);

}  // namespace haptrace
