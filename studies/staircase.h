// The staircase: what energy a sampled wall creates, and when it makes a device bounce for ever.
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

/// A real wall's force against depth is a line. A sampled wall knows the depth once a tick and holds its force until
/// the next: a staircase, above the line on the way out and below it on the way in. What it encloses is energy that the
/// wall created. With K the stiffness and dx what the tool moves into the wall within a tick of T, the held force K d
/// takes K d dx from the hand while K d dx + K dx^2 / 2 is stored, and likewise on the way out:
///
///     E = K / 2 sum(dx^2) = K T / 2 integral(v^2 dt)            of a press to depth D, a half sine in time t:
///     E = pi^2 K T D^2 / (4 t)
///
/// Where in a tick the surface is met adds at most K (v T)^2 / 8 to that or takes it away, v the speed there (the tick
/// that enters counts the square of its part inside, the one that leaves that of what it is late), and a tick that is
/// not short against the press takes (pi T / t)^2 / 12 of it.
///
/// A device with damping b dissipates more than the wall creates when b > K T / 2 (Colgate and Brown 1994); damping B
/// of the wall's own counts against that, b > K T / 2 + |B| (Colgate and Schenkel 1997).
struct StaircaseOptions {
  std::vector<double> rates{100, 200, 500, 1000, 2000, 5000, 10000, 20000};  ///< [Hz]
  nlohmann::json scene;  ///< as in a file; null: a wall, of each stiffness in turn
  std::string scene_name = "the scene";

  // The prescribed press: a hand that nothing stops.
  std::vector<double> pressed{300, 1000, 3000};  ///< stiffness of the wall [N/m]
  double depth = 5e-3;                           ///< [m]
  double duration = 0.2;                         ///< in the wall [s]
  int phases = 8;                                ///< of the tick in which the surface is met

  // The tap: a simulated device falls on the wall, pressed by a constant force.
  std::vector<double> tapped;     ///< stiffness of the wall [N/m], ascending; empty: 13 from 100 N/m to 100 kN/m
  std::optional<SimSpec> device;  ///< none: 0.2 kg, 1 N s/m, 0.3 N of friction, nothing else
  double push = 1;                ///< towards the wall, and at least three times the friction [N]
  double height = 5e-3;           ///< from which it falls [m]
  double watched = 4;             ///< before what still moves is judged [s]
  std::uint64_t seed = 1;

  std::size_t threads = 0;  ///< 0: one for every core. Results do not depend on it
};

/// Presses of all phases at one rate.
struct StaircasePress {
  double rate_hz, stiffness;  ///< [Hz], [N/m]
  double mean, least, most;   ///< energy created by a press [J]
  double expected;            ///< the closed form [J]
  double slack;               ///< by which the phases may differ from it [J]
  double supervised;          ///< created at the worst tick with the passivity layer, over all phases [J]
};

/// One tap.
struct StaircaseTap {
  double rate_hz, stiffness;  ///< [Hz], [N/m]
  bool friction, supervised;  ///< the device has its friction; a passivity layer is on
  bool calm;                  ///< it came to rest, or moved ever less; else it bounced on
  double created;             ///< by the motors beyond what the wall holds, at the worst instant [J]
  double asked;               ///< damping that the wall asks of a device, see LoopAnalysis::passive_damping [N s/m]
};

/// The force of one press against its depth, as it was sent: corners of the stairs.
struct Stairs {
  double rate_hz, stiffness;  ///< [Hz], [N/m]
  std::vector<double> depth;  ///< [m]
  std::vector<double> force;  ///< out of the wall [N]
};

struct StaircaseReport {
  StaircaseOptions options;             ///< as used
  double mass = 0, viscous = 0;         ///< of the device, on the axis of the least [kg], [N s/m]
  double coulomb = 0, delay = 0;        ///< its friction, and how late its forces are [N], [s]
  double max_damping = 0;               ///< of the passivity layer at the least rate [N s/m]
  bool complete = false;                ///< false: interrupted
  std::vector<Stairs> stairs;           ///< of the first and third rate, and the first and last stiffness
  std::vector<StaircasePress> presses;  ///< rate by rate
  std::vector<StaircaseTap> taps;       ///< rate by rate

  /// The largest stiffness of the list up to which all are calm at this rate; 0: none is [N/m].
  [[nodiscard]] double calm_up_to(double rate_hz, bool friction, bool supervised) const;
  /// The largest that asks for no more damping than the device has [N/m].
  [[nodiscard]] double passive_up_to(double rate_hz) const;
};

/// Measures both with the scene, the controller, the servo loop and the passivity layer that sessions use, without
/// their fades and limits. `progress` is called in the calling thread about ten times a second with the part that is
/// done. Raised, `stop` ends it early. Throws Error(input) when an option is out of range, the scene cannot be read, or
/// nothing of it knows where its surface is.
StaircaseReport staircase(const StaircaseOptions& options, const StopRequest& stop,
                          const std::function<void(double)>& progress = {});

nlohmann::json to_json(const StaircaseReport& report);
std::string text_of(const StaircaseReport& report);

/// Force against depth; energy created against rate, with the closed form; which walls are calm, without and with the
/// passivity layer.
Figure figure_of(const StaircaseReport& report);

}  // namespace haptrace
