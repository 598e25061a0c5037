// The staircase: energy that a sampled wall creates, and the stiffness at which a device bounces for ever.
#pragma once

#include "devices/loop/servo_loop.h"
#include "devices/sim/spec.h"
#include "plot/figure.h"

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// The force of a real wall over depth is a line. A sampled wall knows the depth once per tick and holds its force
/// until the next. The result is a staircase, above the line on the way out and below it on the way in. The enclosed
/// area is energy that the wall created. With stiffness K and movement dx into the wall within a tick of T, the held
/// force K d takes K d dx from the hand while K d dx + K dx^2 / 2 is stored, and likewise on the way out:
///
///     E = K / 2 sum(dx^2) = K T / 2 integral(v^2 dt)            of a press to depth D, a half sine in time t:
///     E = pi^2 K T D^2 / (4 t)
///
/// The phase of the tick at which the tool meets the surface adds or subtracts at most K (v T)^2 / 8, v being the speed
/// there. (The entering tick counts the square of its part inside, the leaving tick the square of its lateness.) A tick
/// that is not short against the press reduces the energy by a share of (pi T / t)^2 / 12.
///
/// A device with damping b dissipates more than the wall creates when b > K T / 2 (Colgate and Brown 1994); damping B
/// of the wall's own counts against that, b > K T / 2 + |B| (Colgate and Schenkel 1997).
struct StaircaseOptions {
  std::vector<double> rates{100, 200, 500, 1000, 2000, 5000, 10000, 20000};  ///< [Hz]
  nlohmann::json scene;  ///< scene as in a file; null: a wall of each stiffness in turn
  std::string scene_name = "the scene";

  // Prescribed press: a movement that no force stops.
  std::vector<double> pressed{300, 1000, 3000};  ///< stiffness of the wall [N/m]
  double depth = 5e-3;                           ///< depth of the press [m]
  double duration = 0.2;                         ///< duration of the press in the wall [s]
  int phases = 8;                                ///< number of phases of the tick at which the surface is met

  // Tap: a simulated device falls on the wall, pressed by a constant force.
  std::vector<double> tapped;     ///< stiffness of the wall [N/m], ascending; empty: 13 values from 100 N/m to 100 kN/m
  std::optional<SimSpec> device;  ///< absent: 0.2 kg, 1 N s/m and 0.3 N of friction only
  double push = 1;                ///< force towards the wall, raised to at least three times the friction [N]
  double height = 5e-3;           ///< height of the fall [m]
  double watched = 4;             ///< time before a device that still moves is judged [s]
  std::uint64_t seed = 1;

  std::size_t threads = 0;  ///< 0: one for every core. Results do not depend on it
};

/// Results of the presses of all phases at one rate and stiffness.
struct StaircasePress {
  double rate_hz, stiffness;  ///< [Hz], [N/m]
  double mean, least, most;   ///< energy created by a press: mean, least and most over the phases [J]
  double expected;            ///< energy by the closed form [J]
  double slack;               ///< largest expected deviation of a phase from the closed form [J]
  double supervised;          ///< largest energy at any tick of all phases with the passivity layer [J]
};

/// Result of one tap.
struct StaircaseTap {
  double rate_hz, stiffness;  ///< [Hz], [N/m]
  bool friction, supervised;  ///< device with its friction; with a passivity layer
  bool calm;                  ///< the device came to rest or its swing kept shrinking; else it bounced on
  double created;             ///< largest energy given by the motors beyond what the wall stores [J]
  double asked;               ///< damping that the wall requires of a device, see LoopAnalysis::passive_damping [N s/m]
};

/// Sent force of one press over its depth: the corners of the stairs.
struct Stairs {
  double rate_hz, stiffness;  ///< [Hz], [N/m]
  std::vector<double> depth;  ///< [m]
  std::vector<double> force;  ///< out of the wall [N]
};

struct StaircaseReport {
  StaircaseOptions options;             ///< as used
  double mass = 0, viscous = 0;         ///< smallest mass and damping of the device's axes [kg], [N s/m]
  double coulomb = 0, delay = 0;        ///< smallest friction and total delay of its force [N], [s]
  double max_damping = 0;               ///< damping limit of the passivity layer at the first rate [N s/m]
  bool complete = false;                ///< false: interrupted
  std::vector<Stairs> stairs;           ///< for the first and third rate, and the first and last stiffness
  std::vector<StaircasePress> presses;  ///< rate by rate
  std::vector<StaircaseTap> taps;       ///< rate by rate

  /// Returns the largest stiffness of the list up to which all taps are calm at this rate [N/m]; 0: none.
  [[nodiscard]] double calm_up_to(double rate_hz, bool friction, bool supervised) const;
  /// Returns the largest stiffness that requires no more damping than the device has [N/m].
  [[nodiscard]] double passive_up_to(double rate_hz) const;
};

/// Runs presses and taps with the scene, the controller, the servo loop and the passivity layer of a session, without
/// their fades and limits. Calls `progress` in the calling thread about ten times a second with the finished share.
/// Raising `stop` ends the study early. Throws Error(input) when an option is out of range, the scene cannot be read,
/// or no object of it knows its surface.
StaircaseReport staircase(const StaircaseOptions& options, const StopRequest& stop,
                          const std::function<void(double)>& progress = {});

nlohmann::json to_json(const StaircaseReport& report);
std::string text_of(const StaircaseReport& report);

/// Returns a plot of force over depth, of created energy over rate with the closed form, and of the calm walls without
/// and with the passivity layer.
Figure figure_of(const StaircaseReport& report);

}  // namespace haptrace
