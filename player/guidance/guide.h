// Teaching: an expert's recording guides a trainee's hand.
#pragma once

#include "control/design/tracking_design.h"
#include "control/path/trajectory.h"
#include "formats/documents/radius_profile.h"
#include "formats/path/path_source.h"
#include "player/guidance/guidance_controller.h"
#include "player/playback/tracking_metrics.h"
#include "player/session.h"

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Which force of the expert's a trainee feels. Recorded forces are those on the hand, in W.
enum class Feel {
  active,  ///< the recorded force as it is: what pushed the expert's hand pushes the trainee's
  resist,  ///< its opposite: the trainee has to bring up the force that was recorded
};

Feel parse_feel(std::string_view name);  ///< throws Error(input) naming the known ones

struct GuideOptions {
  GuidanceOptions guidance;
  double radius = 5e-3;                         ///< of the tunnel [m]
  std::optional<RadiusProfile> radius_profile;  ///< along the path, in place of `radius`
  /// Further recordings of the same task: where these leave the path farther than `radius`, the tunnel is as wide.
  std::vector<std::shared_ptr<const PathSource>> spread;
  bool free = false;                ///< nothing is sent on the path: what follows here does not matter
  std::optional<double> stiffness;  ///< of the walls [N/m]; as stiff as device and rate bear when absent
  bool expert = false;              ///< do not clamp the stiffness to what they bear
  double onset = 1e-3;              ///< over which the stiffness rises [m]
  double damping = 3;               ///< of what moves outwards in the wall [N s/m]
  double force_scale = 1;           ///< of the expert's forces; 0: none
  Feel feel = Feel::active;
  std::optional<PaceHelp::Options> pace;
  double resistance = 0, viscosity = 0;  ///< [N s/m]
  double amplify = 0;                    ///< of errors within the tunnel [N/m]
  double amplify_force = 1;              ///< at most [N]
  double energy = 0.3;                   ///< of the tank [J], see Guidance
  bool guard = true;                     ///< soften when the loop oscillates
  bool fit = false;                      ///< move and scale the path into the workspace
  std::optional<double> smoothing;       ///< as for PlayOptions
  std::optional<double> spacing;         ///< of the path's knots [m]; ArcPath::spacing_for when absent
  std::optional<IdentifiedDevice> identified;
  SessionOptions session;
  std::vector<SampleSink*> sinks;  ///< borrowed
};

/// From a force's sending to its effect, on a device that nobody calibrated: no device of the kind is later, and walls
/// that reckon with less than the truth give energy that no account sees [s].
inline constexpr double kUnknownDelay = 5e-3;

/// A guidance that was checked against a device and is ready to run: nothing has been sent yet.
struct GuidePlan {
  std::shared_ptr<const ArcPath> path;
  std::optional<Fit> fit;
  double duration = 0;             ///< the expert's [s]
  double stiffness = 0;            ///< of the walls, as they will be [N/m]
  double delay = 0;                ///< that the account of energies reckons with [s]
  double wall_force = 0;           ///< that they pull with at most [N]
  bool has_forces = false;         ///< the expert's were recorded
  std::vector<std::string> notes;  ///< what a person should know
};

/// Checks everything that can be checked before a force is sent. Reads the whole path. Throws Error(input).
GuidePlan plan_guidance(const DeviceInfo& device, std::shared_ptr<const PathSource> expert,
                        const GuideOptions& options);

/// One repetition, over phase run.
struct GuideFigures {
  TrackingFigures tracking;      ///< its error is the distance from the path
  double time_in_tunnel = kNaN;  ///< share of the time; NaN when there was none
  double progress = 0;           ///< how far along the path [m]
  double force_error = kNaN;     ///< rms, sent force against the expert's within the tunnel [N]; NaN without forces
};

struct GuideResult {
  SessionResult session;
  GuidePlan plan;
  std::vector<GuideFigures> repetitions;
  GuideFigures last;
  double energy_given = 0;   ///< to the hand beyond what springs hold [J]
  double energy_budget = 0;  ///< that it is never to pass [J]
};

/// The controller that guide() runs, for sessions of another kind. Without a time limit unless the options have one.
GuidanceController guidance_controller(const DeviceInfo& device, const GuidePlan& plan, const GuideOptions& options);

/// Guides a trainee who holds `device` along `plan`. In virtual time a repetition without a time limit ends after ten
/// times the expert's duration and 10 s.
GuideResult guide(Device& device, const GuidePlan& plan, const GuideOptions& options, const StopRequest& stop,
                  const Progress& progress = {});

nlohmann::json to_json(const GuideResult& result);

}  // namespace haptrace
