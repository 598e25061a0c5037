// Guidance of a trainee's hand by an expert's recording.
#pragma once

#include "control/design/identified_device.h"
#include "control/guidance_options.h"
#include "control/initiation.h"
#include "control/path/path.h"
#include "formats/documents/radius_profile.h"
#include "player/playback/tracking_figures.h"
#include "player/session.h"

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

class ArcPath;
class LiveGuidance;
class PathSource;

/// Sign of the expert's force that the trainee feels. Recorded forces act on the hand and are expressed in W.
enum class Feel {
  active,  ///< the recorded force: the force on the expert's hand acts on the trainee's
  resist,  ///< the opposite force: the trainee must exert the recorded force
};

Feel parse_feel(std::string_view name);  ///< throws Error(input) that names the known values

struct GuideOptions {
  GuidanceOptions guidance;
  double radius = 5e-3;                         ///< radius of the tunnel [m]
  std::optional<RadiusProfile> radius_profile;  ///< radius along the path; replaces `radius`
  /// The profile came with the path (averaged_radius): it is placed and scaled with it, and at least `radius`.
  bool radius_of_path = false;
  /// Further recordings of the same task. Where they leave the path by more than `radius`, the tunnel becomes as wide.
  /// Recordings of another movement are refused, see require_same_movement().
  std::vector<std::shared_ptr<const PathSource>> spread;
  bool free = false;                  ///< no force is sent on the path; the force settings below have no effect
  bool tunnel_without_walls = false;  ///< with `free`: the tunnel is still recorded, shown and counted
  std::optional<double> stiffness;  ///< stiffness of the walls [N/m]; absent: the largest stable one, at most 1000 N/m
  bool expert = false;              ///< do not clamp the stiffness to the stable range
  double onset = 1e-3;              ///< depth over which the stiffness rises [m]
  double damping = 3;               ///< damping of outward movement in the wall [N s/m]
  double force_scale = 1;           ///< scale of the expert's forces; 0: none
  bool force_expected = true;       ///< forces that are all zero cause a warning, not only a note
  Feel feel = Feel::active;
  std::optional<PaceHelpOptions> pace;
  /// Helps a trainee who does not start. Its force stays within the device's continuous force. Not with a cursor.
  std::optional<BackWallOptions> initiate;
  double resistance = 0, viscosity = 0;  ///< [N s/m]
  double amplify = 0;                    ///< amplification of errors within the tunnel [N/m]
  double amplify_force = 1;              ///< largest force of the amplification [N]
  double energy = 0.3;                   ///< content of the energy tank [J], see Guidance
  bool guard = true;                     ///< soften when the loop oscillates
  bool fit = false;                      ///< move and scale the path into the workspace
  std::optional<double> smoothing;       ///< see PlayOptions
  std::optional<double> spacing;         ///< spacing of the path's knots [m]; ArcPath::spacing_for when absent
  std::optional<IdentifiedDevice> identified;
  SessionOptions session;
  std::vector<SampleSink*> sinks;  ///< borrowed
  /// Borrowed, may be null. Changes the guidance while it runs; begin() was called with guide_scope(). Its notices
  /// become warnings of the session.
  LiveGuidance* live = nullptr;
};

/// Returns the largest stiffness of walls that is stable on a device [N/m], see largest_wall_stiffness(): with the
/// damping of its calibration, or 1 N s/m without one. `delay` [s].
double largest_stable_stiffness(const std::optional<IdentifiedDevice>& identified, double rate_hz, double delay);

/// Guidance that was checked against a device and is ready to run. No force has been sent yet.
struct GuidePlan {
  std::shared_ptr<const ArcPath> path;
  std::optional<Fit> fit;
  double duration = 0;                      ///< duration of the expert's path [s]
  double stiffness = 0;                     ///< stiffness of the walls, after clamping [N/m]
  double largest_stiffness = 0;             ///< largest stiffness that commands may set [N/m]
  double delay = 0;                         ///< delay in the energy account [s]
  double wall_force = 0;                    ///< largest force of the walls [N]
  std::optional<BackWallOptions> initiate;  ///< as the device allows it
  bool has_forces = false;                  ///< the expert's recording contains forces
  std::vector<std::string> notes;           ///< messages for the user
  std::vector<std::string> warnings;        ///< messages that matter more
};

/// Checks the path, the options and the device before a force is sent, and computes the plan. Reads the whole path.
/// Throws Error(input).
GuidePlan plan_guidance(const DeviceInfo& device, std::shared_ptr<const PathSource> expert,
                        const GuideOptions& options);

/// Metrics of one repetition, over phase run.
///
/// A repetition whose time is over counts as a partial one. It ranks below every finished one, independent of its other
/// metrics (is_better).
struct GuideFigures {
  TrackingFigures tracking;              ///< the error is the distance from the path
  double time_in_tunnel = kNaN;          ///< share of the samples; NaN without samples or tunnel
  double progress = 0;                   ///< farthest place on the path [m]
  double completion = kNaN;              ///< share of the path that this is, 0 to 1; NaN for a path without length
  bool partial = false;                  ///< the trainee did not reach the end
  std::optional<Initiation> initiation;  ///< with a back wall
  double force_error = kNaN;  ///< rms difference of sent and expert's force within the tunnel [N]; NaN without forces
};

/// Returns true if `a` is better than `b`: a finished repetition than a partial one; of two partial ones that with more
/// of the path; of two finished ones that with the smaller rms error.
bool is_better(const GuideFigures& a, const GuideFigures& b);

struct GuideResult {
  SessionResult session;
  GuidePlan plan;
  std::vector<GuideFigures> repetitions;
  GuideFigures last;
  double energy_given = 0;   ///< energy given to the hand beyond what springs store [J]
  double energy_budget = 0;  ///< upper bound on energy_given [J]
  double time_in_doubt = 0;  ///< share of the time on the path in which the place was in doubt
  double time_empty = 0;     ///< share of that time in which the energy tank was empty, see GuidanceController
};

/// Returns the path and the tunnel of `plan`, for a view.
FollowedPath followed_path(const GuidePlan& plan, const GuideOptions& options);

/// Guides a trainee who holds `device` along `plan`. In virtual time, a repetition without a time limit ends after ten
/// times the expert's duration plus 10 s.
GuideResult guide(Device& device, const GuidePlan& plan, const GuideOptions& options, const StopRequest& stop,
                  const Progress& progress = {});

nlohmann::json to_json(const GuideResult& result);

}  // namespace haptrace
