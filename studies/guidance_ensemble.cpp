#include "studies/guidance_ensemble.h"

#include "base/error.h"
#include "control/guidance.h"
#include "control/path/arc_path.h"
#include "control/ripple.h"
#include "control/tunnel_wall.h"
#include "devices/sim/sim_device.h"
#include "formats/path/path_source.h"
#include "player/guidance/guidance_controller.h"
#include "studies/ensemble_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

using nlohmann::json;

constexpr double kLinger = 1;        // extra time after the end of the trainee's intent [s]
constexpr double kHoldLimit = 3600;  // longer than any trial: the judge ends the session

/// Measures lasting ripple of the true position above the frequencies of hands. Impacts and a hand that lets go do not
/// last.
class TrueRipple {
 public:
  TrueRipple(const SimDevice& device, double rate_hz)
      : device_(device),
        origin_(device.true_position()),
        ticks_(std::max<std::int64_t>(std::llround(guidance_ensemble::kRippleTime / kStretches * rate_hz), 1)),
        ripple_(guidance_ensemble::kRippleCutoff, rate_hz) {}

  /// Called at every tick; counts from the first `judged` one on.
  void update(bool judged) noexcept {
    const double ripple2 = ripple_.update(device_.true_position() - origin_);
    if (!judged) return;
    sum_ += ripple2;
    if (++count_ % ticks_ != 0) return;
    std::rotate(stretches_.begin(), stretches_.begin() + 1, stretches_.end());
    stretches_.back() = sum_ / static_cast<double>(ticks_);
    sum_ = 0;
    lasting2_ = std::max(lasting2_, *std::min_element(stretches_.begin(), stretches_.end()));
  }

  /// Returns the largest ripple that lasted for guidance_ensemble::kRippleTime, rms [m].
  [[nodiscard]] double lasting() const noexcept { return std::sqrt(lasting2_); }

 private:
  static constexpr int kStretches = 3;

  const SimDevice& device_;
  Vec3 origin_;
  std::int64_t ticks_, count_ = 0;
  Ripple ripple_;
  double sum_ = 0, lasting2_ = 0;
  std::array<double, kStretches> stretches_{};  ///< mean squares of the last stretches [m^2]
};

/// Evaluates guidance by the true state of a simulated device.
class GuidanceJudge final : public SampleSink {
 public:
  /// Raises `end` at `duration` [s] of the session.
  GuidanceJudge(const SimDevice& device, const Guidance& guidance, const GuidePlan& plan, const GuideOptions& options,
                double duration, StopRequest& end)
      : device_(device),
        guidance_(guidance),
        path_(*plan.path),
        wall_({.stiffness = plan.stiffness, .onset = options.onset, .max_force = plan.wall_force}),
        cursor_(options.guidance.cursor),
        rate_hz_(options.session.loop.rate_hz),
        blending_(std::llround(GuidanceController::kBlend * rate_hz_) + 2),
        end_(end),
        end_ns_(std::llround(1e9 * duration)),
        rest_ns_(end_ns_ - std::llround(1e9 * guidance_ensemble::kRestJudged)),
        ripple_(device, rate_hz_) {}

  void push(const Event& event) noexcept override {
    // On a device with a long delay, walls sway too slowly for the fast rules.
    if (is_oscillation(event.code) || event.code == EventCode::sways) ++run_.oscillations;
  }

  void push(const Sample& sample) noexcept override {
    const bool guides = sample.phase == Phase::run || sample.phase == Phase::hold;
    const bool judged = guides && ++guided_ >= blending_;
    ripple_.update(judged);
    if (!guides) return;
    if (!judged) {
      begin(sample);
      return;
    }
    run_.given = device_.plant().motor_work() - work_ + stored(sample) - stored_;
    run_.budget = guidance_.budget();
    run_.excess = std::max(run_.excess, run_.given - run_.budget);
    run_.ripple = ripple_.lasting();
    run_.speed = std::max(run_.speed, device_.true_velocity().norm());
    run_.progress = std::max(run_.progress, sample.progress / std::max(path_.length(), 1e-9));
    // A place that moves elsewhere without forces does not count.
    if (!cursor_ && guidance_.certainty() > 0)
      run_.jump = std::max(run_.jump, (sample.reference_position - place_).norm() - (sample.position - tool_).norm());
    place_ = sample.reference_position;
    tool_ = sample.position;
    if (sample.time_ns < rest_ns_) return;
    rest2_ += device_.true_velocity().squaredNorm();
    run_.rest = std::sqrt(rest2_ / static_cast<double>(++rested_));
    if (sample.time_ns >= end_ns_ && end_.count() == 0) end_.raise();
  }

  [[nodiscard]] const GuidanceRun& run() const noexcept { return run_; }

 private:
  /// Resets the references of the evaluation, which starts once guidance alone acts.
  void begin(const Sample& sample) noexcept {
    work_ = device_.plant().motor_work();
    stored_ = stored(sample);
    place_ = sample.reference_position;
    tool_ = sample.position;
    run_.excess = -guidance_.budget();
  }

  [[nodiscard]] double stored(const Sample& sample) const noexcept {
    PathProjection::Foot foot;
    foot.place = path_.at(sample.progress);
    foot.tube = PathProjection::tube_of(guidance_.tube().centre, guidance_.tube().radius, device_.true_position());
    return guidance_.wall_share() * wall_.stored(foot, {}) + guidance_.release().stored(device_.true_position());
  }

  const SimDevice& device_;
  const Guidance& guidance_;
  const ArcPath& path_;
  TunnelWall wall_;
  bool cursor_;
  double rate_hz_;
  std::int64_t blending_;  ///< [ticks]
  StopRequest& end_;
  std::int64_t end_ns_, rest_ns_;
  TrueRipple ripple_;
  double rest2_ = 0;
  std::int64_t guided_ = 0, rested_ = 0;  ///< [ticks]
  double work_ = 0, stored_ = 0;          ///< values when guidance alone started to act [J]
  Vec3 place_ = Vec3::Zero(), tool_ = Vec3::Zero();
  GuidanceRun run_;
};

/// One draw on one path.
class GuidedTrial {
 public:
  GuidedTrial(const GuidanceDraw& draw, const Path& expert) : draw_(draw), expert_(expert) {
    const Path intent = intent_of(draw.trainee, expert);
    sim_.name = draw.device.spec.model;
    sim_.seed = draw.device.noise_seed;
    sim_.intent = Trajectory(intent, Interpolation::linear);
    if (draw.trainee.lets_go)
      sim_.lets_go_at = kTraineeWaits + *draw.trainee.lets_go * (intent.duration() - kTraineeWaits);
  }

  GuidanceRun guided(const StopRequest& stop, double& stiffness) const {
    SimDevice device(draw_.device.spec, sim_);
    GuideOptions options = draw_.guide;
    options.guidance.time_limit = intended() + kLinger;
    options.guidance.hold = kHoldLimit;
    options.session.loop.watch_vibration = options.guard;
    const GuidePlan plan = plan_guidance(device.info(), source_of(expert_), options);
    stiffness = plan.stiffness;
    GuidanceController controller = guidance_controller(device.info(), plan, options);
    StopRequest end(&stop);
    GuidanceJudge judge(device, controller.guidance(), plan, options, duration(), end);
    std::array<SampleSink*, 1> sinks{&judge};
    const SessionResult session =
        run_session(device, controller, {.reference = true, .guidance = true}, sinks, options.session, end);
    GuidanceRun run = judge.run();
    if (session.servo.cause != StopCause::interrupted) run.cause = session.servo.cause;
    return run;
  }

  /// Returns the ripple of the same hand on the same device without force [m].
  double alone() const {
    SimDevice device(draw_.device.spec, sim_);
    const double rate_hz = draw_.guide.session.loop.rate_hz;
    TrueRipple ripple(device, rate_hz);
    DeviceState state;
    for (auto ticks = std::llround(duration() * rate_hz); ticks > 0; --ticks) {
      (void)device.exchange({}, 1 / rate_hz, state);
      ripple.update(true);
    }
    return ripple.lasting();
  }

 private:
  [[nodiscard]] double intended() const { return sim_.intent->duration(); }
  [[nodiscard]] double duration() const { return intended() + kLinger + guidance_ensemble::kHold; }

  const GuidanceDraw& draw_;
  const Path& expert_;
  SimOptions sim_;
};

/// Returns draw and path of the runs for which `is` holds.
template <class Is>
json failures_of(const GuidanceReport& report, Is is) {
  json all = json::array();
  for (const GuidanceMember& member : report.members)
    for (std::size_t path = 0; path < member.runs.size(); ++path)
      if (std::invoke(is, member.runs[path])) all.push_back({{"draw", member.index}, {"path", report.paths[path]}});
  return all;
}

template <class Figure>
Distribution distribution(const GuidanceReport& report, Figure figure) {
  std::vector<double> values;
  for (const GuidanceMember& member : report.members)
    for (const GuidanceRun& run : member.runs) values.push_back(static_cast<double>(std::invoke(figure, run)));
  return Distribution::of(values);
}

bool softened(const GuidanceRun& run) {
  return run.oscillations > 0;
}

json guidance_criteria() {
  return {{"excess_j", guidance_ensemble::kMostExcess},
          {"jump_m", guidance_ensemble::kMostJump},
          {"ripple_above_hz", guidance_ensemble::kRippleCutoff},
          {"ripple_time_s", guidance_ensemble::kRippleTime},
          {"ripple_m", guidance_ensemble::kMostRipple},
          {"ripple_of_hand_alone", guidance_ensemble::kMoreThanAlone},
          {"hold_s", guidance_ensemble::kHold},
          {"rest_judged_s", guidance_ensemble::kRestJudged},
          {"rest_m_per_s", guidance_ensemble::kMostRest}};
}

json to_json(const GuidanceRun& run) {
  return {{"stopped_by", to_string(run.cause)},
          {"energy_given_j", run.given},
          {"energy_budget_j", run.budget},
          {"energy_excess_j", run.excess},
          {"jump_m", run.jump},
          {"ripple_m", run.ripple},
          {"rest_m_per_s", run.rest},
          {"ripple_alone_m", run.ripple_alone},
          {"max_speed_m_per_s", run.speed},
          {"progress", run.progress},
          {"oscillations_noticed", run.oscillations},
          {"failed", run.failed()}};
}

json to_json(const GuidanceMember& member, const std::vector<std::string>& paths) {
  json runs = json::object();
  for (std::size_t i = 0; i < member.runs.size(); ++i) runs[paths[i]] = to_json(member.runs[i]);
  return {{"draw", member.index},
          {"rate_hz", member.rate_hz},
          {"delay_s", member.delay},
          {"radius_m", member.radius},
          {"stiffness_n_per_m", member.stiffness},
          {"cursor", member.cursor},
          {"held", member.held},
          {"calibrated", member.calibrated},
          {"runs", runs}};
}

}  // namespace

std::size_t GuidanceReport::failures() const noexcept {
  std::size_t count = 0;
  for (const GuidanceMember& member : members)
    count += static_cast<std::size_t>(
        std::count_if(member.runs.begin(), member.runs.end(), [](const GuidanceRun& run) { return run.failed(); }));
  return count;
}

GuidanceMember run_guidance_member(const GuidanceDraw& draw, const std::vector<Path>& paths, const StopRequest& stop) {
  const SimSpec& spec = draw.device.spec;
  GuidanceMember member{.index = draw.index,
                        .rate_hz = draw.guide.session.loop.rate_hz,
                        .delay = spec.delay + 1 / (2 * std::numbers::pi * spec.actuator_bandwidth_hz),
                        .radius = draw.guide.radius,
                        .cursor = draw.guide.guidance.cursor,
                        .held = spec.hand.has_value(),
                        .calibrated = draw.guide.identified.has_value()};
  for (const Path& path : paths) {
    if (stop.count() > 0) break;
    const GuidedTrial trial(draw, path);
    GuidanceRun& run = member.runs.emplace_back(trial.guided(stop, member.stiffness));
    if (run.ripple > guidance_ensemble::kMostRipple) run.ripple_alone = trial.alone();
  }
  return member;
}

GuidanceReport run_guidance_ensemble(const GuidanceEnsembleOptions& options, const StopRequest& stop,
                                     const std::function<void(const EnsembleProgress&)>& progress) {
  check_draws(options.draws);
  const std::vector<Path> paths = options.paths.empty() ? guidance_paths() : options.paths;
  GuidanceReport report{.seed = options.seed, .draws = options.draws};
  // A path that no device of the ensemble could play is rejected before the first draw runs.
  const SimDevice any(draw_device(options.seed, options.first).spec);
  for (const Path& path : paths) {
    (void)plan_guidance(any.info(), source_of(path), {});
    report.paths.push_back(path.name);
  }
  report.members = run_draws<GuidanceMember>(
      options.draws, options.threads, stop,
      [&](std::size_t draw) {
        return run_guidance_member(draw_guidance(options.seed, options.first + draw), paths, stop);
      },
      progress);
  return report;
}

json to_json(const GuidanceReport& report) {
  json members = json::array();
  for (const GuidanceMember& member : report.members) members.push_back(to_json(member, report.paths));
  return {{"seed", report.seed},
          {"draws_asked", report.draws},
          {"draws", report.members.size()},
          {"paths", report.paths},
          {"failed", report.failures()},
          {"beyond_budget", failures_of(report, &GuidanceRun::overdrawn)},
          {"jumped", failures_of(report, &GuidanceRun::jumped)},
          {"unstable", failures_of(report, &GuidanceRun::unstable)},
          {"stopped", failures_of(report, &GuidanceRun::stopped)},
          {"softened", failures_of(report, softened)},
          {"energy_given_j", to_json(distribution(report, &GuidanceRun::given))},
          {"energy_excess_j", to_json(distribution(report, &GuidanceRun::excess))},
          {"jump_m", to_json(distribution(report, &GuidanceRun::jump))},
          {"ripple_m", to_json(distribution(report, &GuidanceRun::ripple))},
          {"rest_m_per_s", to_json(distribution(report, &GuidanceRun::rest))},
          {"max_speed_m_per_s", to_json(distribution(report, &GuidanceRun::speed))},
          {"progress", to_json(distribution(report, &GuidanceRun::progress))},
          {"members", members},
          {"criteria", guidance_criteria()}};
}

std::string text_of(const GuidanceReport& report) {
  std::string text =
      fmt::format("{} of {} random trainees and devices guided along {} paths, seed {}: {} runs failed\n",
                  report.members.size(), report.draws, report.paths.size(), report.seed, report.failures());
  const auto line = [&](const char* what, double unit, const char* unit_name, auto figure, const json& failed) {
    const Distribution d = distribution(report, figure);
    text += fmt::format("  {:<28} median {:8.3f}, p95 {:8.3f}, max {:8.3f} {:<4}  beyond the limit: {}\n", what,
                        d.median / unit, d.p95 / unit, d.max / unit, unit_name, failed.size());
  };
  line("energy beyond the budget", 1e-3, "mJ", &GuidanceRun::excess, failures_of(report, &GuidanceRun::overdrawn));
  line("jump of the foot point", 1e-3, "mm", &GuidanceRun::jump, failures_of(report, &GuidanceRun::jumped));
  line("ripple above 15 Hz", 1e-3, "mm", &GuidanceRun::ripple, failures_of(report, &GuidanceRun::ripples));
  line("speed at rest", 1e-3, "mm/s", &GuidanceRun::rest, failures_of(report, &GuidanceRun::restless));
  text += fmt::format("  walls softened in {} runs, sessions stopped in {} runs\n",
                      failures_of(report, softened).size(), failures_of(report, &GuidanceRun::stopped).size());
  return text;
}

}  // namespace haptrace
