#include "player/guidance/guide.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "base/json_reader.h"
#include "base/statistics.h"
#include "base/suggest.h"
#include "control/back_wall.h"
#include "control/guidance.h"
#include "control/guide_terms.h"
#include "control/hand_watch.h"
#include "control/limits.h"
#include "control/path/arc_path.h"
#include "control/path/place_tracker.h"
#include "control/pd.h"
#include "control/resistance_timer.h"
#include "control/tunnel_wall.h"
#include "devices/loop/servo_loop.h"
#include "formats/documents/session_log.h"
#include "metrics/path_average.h"
#include "player/device_path.h"
#include "player/guidance/expert_path.h"
#include "player/guidance/guidance_controller.h"
#include "player/guidance/live_guidance.h"
#include "player/passivity_defaults.h"
#include "player/playback/tracking_metrics.h"
#include "player/tuning/live_session.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <numeric>

namespace haptrace {
namespace {

constexpr EnumNames<Feel, 2> kFeels{"feel of the expert's force", {"active", "resist"}};

ArcPath arc_path(const std::shared_ptr<const PathSource>& source, const GuideOptions& options) {
  ArcPath path = expert_path(source, options.smoothing, options.spacing, options.radius);
  if (options.radius_profile) {
    const RadiusProfile& profile = *options.radius_profile;
    // A profile that came with the path is placed and scaled with it.
    const double scale = options.radius_of_path && profile.s.back() > 0 ? path.length() / profile.s.back() : 1;
    std::vector<double> radius(path.knots());
    for (std::size_t i = 0; i < radius.size(); ++i) {
      radius[i] = scale * profile.at(path.knot_at(i) / scale);
      if (options.radius_of_path) radius[i] = std::max(radius[i], options.radius);
    }
    path.set_radius(radius);
  }
  return path;
}

/// Widens the tunnel smoothly where the other recordings leave the path by more than its radius. `name` is that of the
/// path. Throws Error(input) naming a recording of another movement.
void widen(ArcPath& path, const std::string& name, const DeviceInfo& device, const GuideOptions& options) {
  constexpr double kSmooth = 5e-3;  // length of the path over which the radius is smoothed [m]
  std::vector<double> radius(path.knots(), options.radius);
  std::vector<DevicePath> others;
  std::vector<PathCopy> copies;
  for (const auto& other : options.spread) {
    others.push_back(path_for(device, other, options.fit));
    copies.push_back({other->facts().name, std::make_shared<const ArcPath>(expert_path(
                                               others.back().source, options.smoothing, options.spacing, 0))});
  }
  // Another movement would open the tunnel anywhere.
  require_same_movement({name, std::make_shared<const ArcPath>(path)}, copies);
  for (const DevicePath& played : others) {
    PlaceTracker tracker(path, {.allow_back = true});
    double before = 0;
    visit_path(played.source, options.smoothing, [&](double t, const Vec3& position, const Vec3&) {
      const auto& foot = tracker.update(position, t - before);
      before = t;
      const std::size_t knot = std::min(path.segment_at(foot.s) + 1, path.knots() - 1);
      for (std::size_t i : {knot - std::min<std::size_t>(knot, 1), knot})
        radius[i] = std::max(radius[i], foot.distance);
    });
  }
  // A moving maximum, then its moving mean: the tunnel is never narrower than the recordings.
  const auto window = static_cast<std::ptrdiff_t>(std::max(kSmooth / path.spacing(), 1.0));
  const auto n = static_cast<std::ptrdiff_t>(radius.size());
  const auto filtered = [&](const std::vector<double>& values, auto&& combine) {
    std::vector<double> result(values.size());
    for (std::ptrdiff_t i = 0; i < n; ++i)
      result[static_cast<std::size_t>(i)] = combine(values.begin() + std::max<std::ptrdiff_t>(i - window, 0),
                                                    values.begin() + std::min(i + window + 1, n));
    return result;
  };
  const std::vector<double> widest =
      filtered(radius, [](auto begin, auto end) { return *std::max_element(begin, end); });
  path.set_radius(filtered(widest, [](auto begin, auto end) {
    return std::accumulate(begin, end, 0.0) / static_cast<double>(end - begin);
  }));
}

/// Returns true if the session has a tunnel, with or without walls.
bool has_tunnel(const GuideOptions& options) {
  return !options.free || options.tunnel_without_walls;
}

/// Returns the scale of the expert's forces; negative where the trainee has to overcome them.
double felt_scale(const GuideOptions& options) {
  return options.feel == Feel::active ? options.force_scale : -options.force_scale;
}

GuideTerms compose(const GuidePlan& plan, const GuideOptions& options) {
  GuideTerms terms;
  if (options.free) return terms;
  terms.push_back(std::make_unique<TunnelWall>(
      TunnelWall::Options{.stiffness = plan.stiffness, .onset = options.onset, .max_force = plan.wall_force}));
  if (options.damping > 0) terms.push_back(std::make_unique<WallDamping>(options.damping, options.onset));
  if (options.force_scale > 0 && plan.has_forces) terms.push_back(std::make_unique<ExpertForce>(felt_scale(options)));
  if (options.pace) terms.push_back(std::make_unique<PaceHelp>(*options.pace));
  if (options.resistance > 0) terms.push_back(std::make_unique<Resistance>(options.resistance));
  if (options.viscosity > 0) terms.push_back(std::make_unique<Viscosity>(options.viscosity));
  if (options.amplify > 0)
    terms.push_back(std::make_unique<ErrorAmplification>(options.amplify, options.amplify_force));
  return terms;
}

bool has_no_force(const ArcPath& path) {
  for (std::size_t i = 0; i < path.knots(); ++i)
    if (!path.at(path.knot_at(i)).force.isZero(0)) return false;
  return true;
}

/// Returns the back wall that the device allows: no stiffer than its walls, and within the force that it can hold.
BackWallOptions back_wall(const DeviceInfo& device, BackWallOptions wall, const GuideOptions& options,
                          GuidePlan& plan) {
  const double most = ServoLoop::in_force(device, options.session.loop.limits).max_continuous_force;
  if (most > 0 && wall.max_force > most) {
    plan.notes.push_back(fmt::format(
        "the wall behind the hand pushes with at most {:.2g} N, the continuous force of {}", most, device.model));
    wall.max_force = most;
  }
  if (wall.stiffness > plan.largest_stiffness) {
    plan.notes.push_back(
        fmt::format("the stiffness of the wall behind the hand is limited to {:.0f} N/m, as that of the walls",
                    plan.largest_stiffness));
    wall.stiffness = plan.largest_stiffness;
  }
  return wall;
}

/// Returns the number of repetitions whose metrics are kept.
std::size_t kept_repetitions(const GuideOptions& options) {
  const int asked = std::max(options.guidance.repetitions, 1);
  return static_cast<std::size_t>(options.live != nullptr ? asked + LiveSession::kMostRepeats : asked);
}

/// Computes the metrics of each repetition that TrackingMetrics does not have.
class GuideMetrics final : public SampleSink {
 public:
  GuideMetrics(const GuidePlan& plan, const GuideOptions& options)
      : scale_(felt_scale(options)),
        tunnel_(has_tunnel(options)),
        forces_(plan.has_forces && options.force_scale > 0 && !options.free),
        length_(plan.path->length()),
        sums_(1) {
    sums_.reserve(kept_repetitions(options) + 1);
  }

  void push(const Sample& sample) noexcept override {
    if (sample.phase != Phase::run || std::isnan(sample.progress)) return;
    Sums& sums = sums_.back();
    const double distance = (sample.position - sample.reference_position).norm();
    ++sums.samples;
    sums.progress = std::max(sums.progress, sample.progress);
    if (distance > sample.tunnel_radius) return;
    ++sums.inside;
    sums.force_error2 += (sample.force - scale_ * sample.reference_force).squaredNorm();
  }

  void push(const Event& event) noexcept override {
    if (event.code == EventCode::time_over) sums_.back().came = event.values[0];
    if (event.code == EventCode::initiation)
      sums_.back().initiation = Initiation{static_cast<Initiator>(event.values[0]), event.values[1], event.values[2]};
    if (event.code != EventCode::repetition) return;
    if (sums_.back().samples > 0 && sums_.size() < sums_.capacity())
      sums_.emplace_back();
    else
      sums_.back() = {};
  }

  [[nodiscard]] std::vector<GuideFigures> figures(const std::vector<TrackingFigures>& tracking) const {
    std::vector<GuideFigures> all;
    for (std::size_t i = 0; i < tracking.size() && i < sums_.size(); ++i) {
      const Sums& sums = sums_[i];
      const double progress = sums.came ? std::min(sums.progress, *sums.came) : sums.progress;
      GuideFigures figures{.tracking = tracking[i],
                           .progress = progress,
                           .partial = sums.came || !is_at_end(progress, length_),
                           .initiation = sums.initiation};
      if (length_ > 0) figures.completion = std::min(progress / length_, 1.0);
      if (tunnel_ && sums.samples > 0)
        figures.time_in_tunnel = static_cast<double>(sums.inside) / static_cast<double>(sums.samples);
      if (forces_ && sums.inside > 0)
        figures.force_error = std::sqrt(sums.force_error2 / static_cast<double>(sums.inside));
      all.push_back(figures);
    }
    return all;
  }

 private:
  struct Sums {
    std::uint64_t samples = 0, inside = 0;
    double progress = 0, force_error2 = 0;
    std::optional<double> came;  ///< how far, in a repetition whose time is over [m]
    std::optional<Initiation> initiation;
  };

  double scale_;
  bool tunnel_, forces_;
  double length_;  ///< of the path [m]
  std::vector<Sums> sums_;
};

nlohmann::json to_json(const GuideFigures& figures) {
  nlohmann::json json = to_json(figures.tracking);
  json["time_in_tunnel"] = json_of_number(figures.time_in_tunnel);
  json["progress_m"] = figures.progress;
  json["completion"] = json_of_number(figures.completion);
  json["partial"] = figures.partial;
  if (figures.initiation) json["initiation"] = json_of(*figures.initiation);
  json["force_error_n"] = json_of_number(figures.force_error);
  return json;
}

}  // namespace

Feel parse_feel(std::string_view name) {
  return kFeels.parse(name);
}

bool is_better(const GuideFigures& a, const GuideFigures& b) {
  if (a.partial != b.partial) return b.partial;
  return a.partial ? a.completion > b.completion : a.tracking.rms_error < b.tracking.rms_error;
}

double largest_stable_stiffness(const std::optional<IdentifiedDevice>& identified, double rate_hz, double delay) {
  double damping = 1;
  if (identified)
    for (int axis = 0; axis < 3; ++axis)
      if (identified->plant.mass[axis] > 0) damping = std::min(damping, std::max(identified->plant.viscous[axis], 0.2));
  return largest_wall_stiffness(rate_hz, delay, damping);
}

namespace {

/// Throws Error(input) if a number is out of its range, or options contradict each other.
void check_options(const GuideOptions& options) {
  validate(options.guidance);
  check_range("the radius of the tunnel", options.radius, 0, 1, "m");
  check_range("the onset of the walls", options.onset, 1e-5, 0.1, "m");
  check_range("the damping of the walls", options.damping, 0, 1000, "N s/m");
  check_range("the scale of the expert's forces", options.force_scale, 0, 100, "");
  check_range("the resistance", options.resistance, 0, 1000, "N s/m");
  check_range("the viscosity", options.viscosity, 0, 1000, "N s/m");
  check_range("the amplification of errors", options.amplify, 0, 1e4, "N/m");
  check_range("the largest force of amplification", options.amplify_force, 0, 100, "N");
  if (options.spacing) check_range("the spacing of the path", *options.spacing, 1e-6, 0.1, "m");
  if (options.stiffness) check_range("the stiffness of the walls", *options.stiffness, 1, 1e6, "N/m");
  if (options.pace) {
    check_range("the pace", options.pace->pace, 0.01, 100, "");
    check_range("the margin of the pace", options.pace->margin, 0, 0.99, "");
    check_range("the largest force of the pace", options.pace->max_force, 0, 100, "N");
  }
  if (options.initiate) {
    validate(*options.initiate);
    if (options.guidance.cursor)
      throw input_error(
          "a cursor moves by itself and needs no wall behind the hand; leave out --initiate, or use mode tunnel");
  }
}

/// Plans the force and the stiffness of the walls: at most what the device is stable with, unless an expert insists.
void plan_walls(const DeviceInfo& device, const GuideOptions& options, GuidePlan& plan) {
  // A wall must stay below the device's largest force, which not every driver knows.
  plan.wall_force = device.max_force > 0 ? 0.8 * device.max_force : 5;
  if (options.session.loop.limits.max_force > 0)
    plan.wall_force = std::min(plan.wall_force, 0.8 * options.session.loop.limits.max_force);
  const double bears = largest_stable_stiffness(options.identified, options.session.loop.rate_hz, plan.delay);
  plan.stiffness = options.stiffness.value_or(std::min(bears, 1000.0));
  plan.largest_stiffness = options.expert ? 1e6 : bears;
  if (plan.stiffness > bears && !options.expert) {
    if (!options.free)
      plan.notes.push_back(
          fmt::format("the device is not stable with walls of {:.0f} N/m at {:.0f} Hz; the stiffness of the walls is "
                      "limited to {:.0f} N/m",
                      plan.stiffness, options.session.loop.rate_hz, bears));
    plan.stiffness = bears;
  }
  if (plan.stiffness > bears && !options.free)
    plan.warnings.push_back(fmt::format(
        "walls of {:.0f} N/m are stiffer than the device is stable with ({:.0f} N/m at {:.0f} Hz): they may "
        "vibrate, and give more energy than the budget",
        plan.stiffness, bears, options.session.loop.rate_hz));
}

/// Returns the force that acts on three quarters of a path, by length, within 15 % of its size and direction [N]; 0
/// if there is none, or hardly any.
double steady_force(const ArcPath& path) {
  constexpr std::size_t kPlaces = 200;
  constexpr double kLeast = 0.1, kOff = 0.15, kMost = 0.75;
  std::array<std::vector<double>, 3> parts;
  for (std::size_t i = 0; i < kPlaces; ++i) {
    const Vec3 force = path.at(path.length() * (static_cast<double>(i) + 0.5) / kPlaces).force;
    for (int axis = 0; axis < 3; ++axis) parts[static_cast<std::size_t>(axis)].push_back(force[axis]);
  }
  const Vec3 usual(median(parts[0]), median(parts[1]), median(parts[2]));
  const double size = usual.norm();
  if (!(size >= kLeast)) return 0;
  std::size_t steady = 0;
  for (std::size_t i = 0; i < kPlaces; ++i)
    if ((Vec3(parts[0][i], parts[1][i], parts[2][i]) - usual).norm() <= kOff * size) ++steady;
  return static_cast<double>(steady) >= kMost * kPlaces ? size : 0;
}

/// Adds notes and warnings on the expert's forces that the trainee does not feel. `feels_contacts`: the trainee touches
/// the scene with which the expert was recorded.
void note_forces(const PathFacts& expert, bool feels_contacts, const GuideOptions& options, GuidePlan& plan) {
  if (options.free || !(options.force_scale > 0)) return;
  if (feels_contacts)
    plan.notes.push_back(
        fmt::format("{} was recorded with a scene, so its forces hold the contacts. They are not replayed, because the "
                    "trainee touches the scene itself",
                    expert.name));
  else if (!plan.has_forces)
    plan.notes.push_back(fmt::format("{} contains no forces: the trainee feels only the walls", expert.name));
  if (plan.has_forces)
    if (const double steady = steady_force(*plan.path); steady > 0)
      plan.warnings.push_back(fmt::format(
          "{}: the force hardly changes, {:.2g} N in one direction on most of the path. If it is the weight "
          "of a sensor or the support of an arm, it pushes the trainee: leave it out with --force-scale 0",
          expert.name, steady));
  if (plan.has_forces && has_no_force(*plan.path))
    (options.force_expected || expert.measured ? plan.warnings : plan.notes)
        .push_back(fmt::format("{}: all forces are zero; the trainee feels only the walls", expert.name));
}

}  // namespace

GuidePlan plan_guidance(const DeviceInfo& device, std::shared_ptr<const PathSource> expert,
                        const GuideOptions& options) {
  check_options(options);
  if (!(device.force_axes[0] || device.force_axes[1] || device.force_axes[2]))
    throw input_error(fmt::format("{} has no motors and cannot guide; use a device with motors", device.model));

  const DevicePath played = path_for(device, std::move(expert), options.fit);
  const PathFacts& facts = played.source->facts();
  // The recorded forces hold the contacts, which the scene renders itself.
  const bool feels_contacts = options.session.touch.scene && facts.contacts;
  GuidePlan plan{.fit = played.fit,
                 .duration = facts.duration(),
                 .delay = options.identified ? options.identified->plant.delay : kUnknownDelay,
                 .has_forces = facts.force && !feels_contacts};
  ArcPath path = arc_path(played.source, options);
  if (!options.spread.empty()) widen(path, facts.name, device, options);
  plan.path = std::make_shared<const ArcPath>(std::move(path));

  plan_walls(device, options, plan);
  if (options.initiate && !options.free) plan.initiate = back_wall(device, *options.initiate, options, plan);
  if (played.fit && options.session.touch.scene) plan.notes.emplace_back(kFitMovesNoScene);
  note_forces(facts, feels_contacts, options, plan);
  if (plan.path->length() == 0) plan.notes.push_back("the path has no length: it is a single point");
  if (!options.identified && !options.expert && !options.free)
    plan.notes.push_back(fmt::format(
        "the delay of {} is unknown; walls of {:.0f} N/m are stable up to a delay of {:.0f} ms; calibrate the "
        "device (haptrace calibrate) to allow stiffer walls",
        device.model, plan.stiffness, 1e3 * kUnknownDelay));
  return plan;
}

FollowedPath followed_path(const GuidePlan& plan, const GuideOptions& options) {
  FollowedPath followed{.mode = options.free ? "free" : options.guidance.cursor ? "cursor" : "tunnel"};
  const ArcPath& path = *plan.path;
  const std::size_t points = std::min(path.knots(), FollowedPath::kMostPathPoints);
  for (std::size_t i = 0; i < points; ++i) {
    const double s = points > 1 ? path.length() * static_cast<double>(i) / static_cast<double>(points - 1) : 0;
    const ArcPath::Place place = path.at(s);
    followed.time.push_back(path.time_at(s));
    followed.position.push_back(place.position);
    if (has_tunnel(options)) followed.radius.push_back(place.radius);
  }
  return followed;
}

LiveGuidance::Scope guide_scope(const GuidePlan& plan, const GuideOptions& options) {
  const bool varies = options.radius_profile.has_value() || !options.spread.empty();
  const GuidanceValues values{.radius = varies ? 1 : options.radius,
                              .stiffness = plan.stiffness,
                              .force = options.force_scale,
                              .assist = 1,
                              .damping = options.damping};
  return {.start = values,
          .composed = values,
          .varies = varies,
          .largest_radius = options.guidance.max_deviation,
          .largest_stiffness = plan.largest_stiffness,
          .because = options.expert       ? "limit for every device"
                     : options.identified ? "stability limit of this device"
                                          : "limit without a calibration or --expert",
          .walls = !options.free,
          .expert_force = !options.free && options.force_scale > 0 && plan.has_forces,
          .help = !options.free && (options.pace.has_value() || plan.initiate.has_value()),
          .without = options.free ? "no force acts in mode free" : ""};
}

GuidanceController guidance_controller(const DeviceInfo& device, const GuidePlan& plan, const GuideOptions& options) {
  GuidanceOptions guidance = options.guidance;
  guidance.rate_hz = options.session.loop.rate_hz;
  guidance.tunnel = has_tunnel(options);
  guidance.resolution = std::max(device.position_resolution, 0.0);
  // A trainee may touch the walls for any time, but a reference that moves by itself must not push against a hand for
  // ever.
  if (guidance.cursor || options.pace || plan.initiate) guidance.patience = kPatience;
  GuideTerms terms = compose(plan, options);
  BackWall* wall = nullptr;
  if (plan.initiate) {
    auto term = std::make_unique<BackWall>(plan.path, *plan.initiate);
    wall = term.get();
    terms.push_back(std::move(term));
  }
  GuidanceController controller(
      plan.path,
      Guidance(std::move(terms), {.energy = options.energy, .delay = plan.delay, .rate_hz = guidance.rate_hz}),
      cautious_gains(device.max_force, guidance.rate_hz), guidance);
  controller.watch(hand_watch_of(device.max_force));
  if (wall != nullptr) controller.move_wall(*wall);
  return controller;
}

GuideResult guide(Device& device, const GuidePlan& plan, const GuideOptions& asked, const StopRequest& stop,
                  const Progress& progress) {
  GuideOptions options = asked;
  options.session.loop.watch_vibration &= options.guard;
  // Nobody may be there to come to the end, and virtual time would go on as fast as the machine can.
  if (options.guidance.time_limit == 0 && device.info().virtual_time && options.session.clock != ClockChoice::real)
    options.guidance.time_limit = 10 * plan.duration + 10;
  GuidanceController controller = guidance_controller(device.info(), plan, options);

  if (options.identified) options.session.touch.plant = options.identified->plant;
  if (options.live != nullptr) {
    controller.obey(options.live->requests(), options.live->mailbox());
    options.session.touch.rests_in_pause = true;
    attach(*options.live, device.info(), options.session, options.sinks);
  }

  TrackingMetrics tracking(options.session.loop.rate_hz, kept_repetitions(options));
  GuideMetrics metrics(plan, options);
  options.sinks.push_back(&tracking);
  options.sinks.push_back(&metrics);
  if (options.session.observer != nullptr) options.session.followed = followed_path(plan, options);
  GuideResult result{.plan = plan};
  result.session = run_session(device, controller, {.reference = true, .guidance = true, .tunnel = has_tunnel(options)},
                               options.sinks, options.session, stop, progress);
  result.repetitions = metrics.figures(tracking.repetitions());
  // A repetition that was stopped has no event of its initiation.
  if (!result.repetitions.empty() && !result.repetitions.back().initiation && controller.initiation() != nullptr)
    result.repetitions.back().initiation = *controller.initiation();
  if (!result.repetitions.empty()) result.last = result.repetitions.back();
  result.energy_given = controller.guidance().given();
  result.energy_budget = controller.guidance().budget();
  result.time_in_doubt = controller.share_in_doubt();
  result.time_empty = controller.share_empty();
  return result;
}

nlohmann::json to_json(const GuideResult& result) {
  nlohmann::json json = to_json(result.session);
  const nlohmann::json last = to_json(result.last);
  for (const char* key : {"rms_error_m", "peak_error_m", "force_ripple_n", "time_in_tunnel", "progress_m", "completion",
                          "partial", "force_error_n"})
    json[key] = last.at(key);
  if (result.last.initiation) json["initiation"] = last.at("initiation");
  json["repetitions"] = nlohmann::json::array();
  for (const GuideFigures& figures : result.repetitions) json["repetitions"].push_back(to_json(figures));
  json["path_length_m"] = result.plan.path->length();
  json["stiffness_n_per_m"] = result.plan.stiffness;
  json["energy_given_j"] = result.energy_given;
  json["energy_budget_j"] = result.energy_budget;
  json["time_in_doubt"] = result.time_in_doubt;
  json["time_tank_empty"] = result.time_empty;
  if (result.plan.fit)
    json["fit"] = {{"scale", result.plan.fit->scale}, {"offset_m", json_of(result.plan.fit->offset)}};
  return json;
}

}  // namespace haptrace
