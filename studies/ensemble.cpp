#include "studies/ensemble.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "control/design/tracking_design.h"
#include "control/filters.h"
#include "control/path/shapes.h"
#include "control/ripple.h"
#include "devices/sim/sim_device.h"
#include "player/calibration/calibration.h"
#include "player/motor_limit.h"
#include "player/playback/playback.h"
#include "studies/needed_force.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <utility>

namespace haptrace {
namespace {

using namespace ensemble;

PdGains gains(double kp, double kd) {
  return {Vec3::Constant(kp), Vec3::Constant(kd)};
}

constexpr double kMaxVelocity = 1.5;      // as in haptrace play [m/s]
constexpr double kAtLargest = 0.999;      // share of the device's force from which a tick counts as saturated
constexpr double kOverdriveHold = 2;      // [s]
constexpr double kOverdriveDamping = 25;  // [N s/m]
constexpr double kOnsetCutoff = 8;        // [Hz]
constexpr double kOnsetWindow = 0.025;    // time constant of the mean square [s]
constexpr double kOnsetRipple = 1e-4;     // rms [m]
constexpr double kLasting = 0.2;          // shortest duration of an oscillation; stick-slip ends sooner [s]
constexpr double kCalmTime = 0.5;         // judged time before the end [s]

double rms(double sum, std::uint64_t samples) {
  return samples > 0 ? std::sqrt(sum / static_cast<double>(samples)) : 0;
}

/// Simulated device in a session, for the sinks that judge it.
struct Watched {
  const SimDevice& device;
  const SimSpec& spec;
  double rate_hz;
  double most;  ///< largest force that the session sends and the device gives [N]
};

/// Passes the true position error to a subclass with every sample and counts the reports of the oscillation monitor.
class TruthSink : public SampleSink {
 public:
  explicit TruthSink(const Watched& watched) : device_(watched.device) {}

  void push(const Event& event) noexcept override {
    if (event.code == EventCode::repetition) begin_repetition();
    if (!is_oscillation(event.code)) return;
    if (oscillations_++ == 0) first_oscillation_ = 1e-9 * static_cast<double>(event.time_ns);
  }

  void push(const Sample& sample) noexcept final { see(sample, device_.true_position() - sample.reference_position); }

  [[nodiscard]] int oscillations() const noexcept { return oscillations_; }
  [[nodiscard]] double first_oscillation() const noexcept { return first_oscillation_; }  ///< [s]; NaN: none

 private:
  virtual void begin_repetition() noexcept {}
  virtual void see(const Sample& sample, const Vec3& true_error) noexcept = 0;

  const SimDevice& device_;
  int oscillations_ = 0;
  double first_oscillation_ = kNaN;
};

/// Computes the metrics of the last repetition over phase run.
class RunSink final : public TruthSink {
 public:
  explicit RunSink(const Watched& watched)
      : TruthSink(watched),
        ripple_(kRippleCutoff, watched.rate_hz),
        needed_(watched.spec, watched.rate_hz),
        available_(watched.spec.strongest()),
        largest_(watched.most),
        half_window_(static_cast<std::uint64_t>(std::llround(0.5 * kShakingWindow * watched.rate_hz))) {}

  void write(EnsembleRun& run) const {
    run.rms_error = rms(error2_, samples_);
    run.peak_error = std::sqrt(peak2_);
    run.ripple = rms(ripple2_, samples_);
    run.shaking = std::sqrt(worst2_);
    run.saturated = samples_ > 0 ? static_cast<double>(saturated_) / static_cast<double>(samples_) : 0;
    run.needed_force = most_needed_;
    run.available_force = available_;
    run.stopped_at_largest = stopped_ && at_largest_;
    run.oscillations = oscillations();
  }

 private:
  void begin_repetition() noexcept override {
    error2_ = peak2_ = ripple2_ = half2_ = before2_ = worst2_ = 0;
    samples_ = saturated_ = 0;
  }

  /// Moves the window on by half of its length.
  void judge_shaking(double ripple2) noexcept {
    half2_ += ripple2;
    if (samples_ % half_window_ != 0) return;
    if (samples_ > half_window_)
      worst2_ = std::max(worst2_, (before2_ + half2_) / static_cast<double>(2 * half_window_));
    before2_ = std::exchange(half2_, 0);
  }

  void see(const Sample& sample, const Vec3& true_error) noexcept override {
    const double ripple2 = ripple_.update(true_error);
    const double needed = needed_.update(sample.reference_position).stableNorm();
    if (sample.phase == Phase::approach && phase_ != Phase::approach) most_needed_ = 0;
    phase_ = sample.phase;
    if (phase_ == Phase::approach || phase_ == Phase::run) most_needed_ = std::max(most_needed_, needed);
    stopped_ = sample.phase == Phase::stopped;
    if (!stopped_) at_largest_ = sample.force.stableNorm() >= kAtLargest * largest_;
    if (sample.phase != Phase::run) return;
    ++samples_;
    error2_ += true_error.squaredNorm();
    peak2_ = std::max(peak2_, true_error.squaredNorm());
    ripple2_ += ripple2;
    judge_shaking(ripple2);
    if (at_largest_) ++saturated_;
  }

  Ripple ripple_;
  NeededForce needed_;
  double available_;        ///< of the device [N]
  double largest_;          ///< of the session [N]
  double most_needed_ = 0;  ///< since the approach began [N]
  Phase phase_ = Phase::idle;
  double error2_ = 0, peak2_ = 0, ripple2_ = 0;
  double half2_ = 0, before2_ = 0;  ///< sums of the ripple's square in this half of a window and the one before
  double worst2_ = 0;
  std::uint64_t half_window_;  ///< [ticks]
  std::uint64_t samples_ = 0, saturated_ = 0;
  bool at_largest_ = false, stopped_ = false;
};

/// Computes ripple and hunting at the end of a hold.
class HoldSink final : public TruthSink {
 public:
  explicit HoldSink(const Watched& watched)
      : TruthSink(watched),
        ripple_(kHoldRippleCutoff, watched.rate_hz),
        hunting_(kHuntingCutoff, watched.rate_hz),
        skipped_(std::llround((kHold - kHoldJudged) * watched.rate_hz)) {}

  void write(EnsembleHold& hold) const {
    hold.ripple = rms(ripple2_, samples_);
    hold.hunting = rms(hunting2_, samples_);
    hold.oscillations = oscillations();
  }

 private:
  void see(const Sample& sample, const Vec3& true_error) noexcept override {
    const double ripple2 = ripple_.update(true_error), hunting2 = hunting_.update(true_error);
    if (sample.phase != Phase::hold || held_++ < skipped_) return;
    ++samples_;
    ripple2_ += ripple2;
    hunting2_ += hunting2;
  }

  Ripple ripple_, hunting_;
  std::int64_t skipped_, held_ = 0;  ///< [ticks]
  double ripple2_ = 0, hunting2_ = 0;
  std::uint64_t samples_ = 0;
};

/// Detects the onset of an oscillation and whether it is over at the end.
class OnsetSink final : public TruthSink {
 public:
  explicit OnsetSink(const Watched& watched)
      : TruthSink(watched),
        ripple_(kOnsetCutoff, watched.rate_hz),
        blend_(low_pass_share(1, kOnsetWindow * watched.rate_hz)),
        lasting_(std::llround(kLasting * watched.rate_hz)),
        judged_from_(std::llround((kOverdriveHold - kCalmTime) * watched.rate_hz)) {}

  void write(EnsembleOverdrive& overdrive) const {
    overdrive.onset = onset_;
    overdrive.caught = first_oscillation();
    overdrive.calm = calm_;
  }

 private:
  void see(const Sample& sample, const Vec3& true_error) noexcept override {
    mean2_ += blend_ * (ripple_.update(true_error) - mean2_);
    const bool oscillates = mean2_ > kOnsetRipple * kOnsetRipple;
    lasts_ = oscillates ? lasts_ + 1 : 0;
    if (lasts_ == lasting_ && !std::isfinite(onset_))
      onset_ = std::max(0.0, 1e-9 * static_cast<double>(sample.time_ns) - kLasting);
    if (sample.phase == Phase::hold && held_++ >= judged_from_ && oscillates) calm_ = false;
  }

  Ripple ripple_;
  double blend_, mean2_ = 0;
  std::int64_t lasting_, judged_from_, lasts_ = 0, held_ = 0;  ///< [ticks]
  double onset_ = kNaN;
  bool calm_ = true;
};

/// Returns the reach before the hold: slow, and away from the start position of the device.
Path hold_path() {
  return make_shape("reach", {.size = 0.03, .duration = 1, .angle = 0.7});
}

PlayOptions plain(const PdGains& pd) {
  PlayOptions options;
  options.find_oscillations = true;
  options.gains = pd;
  options.fit = true;
  options.session.velocity = "lowpass:100";
  options.session.loop.limits.max_velocity = kMaxVelocity;
  return options;
}

/// One draw and its trials.
class PathTrials {
 public:
  PathTrials(std::uint64_t seed, std::uint64_t index, EnsembleKind kind, const EnsembleOptions& options,
             const StopRequest& stop)
      : draw_(draw_device(seed, index, kind)), quiet_(draw_.spec), options_(options), stop_(stop) {
    if (quiet_.hand) quiet_.hand->tremor = quiet_.hand->drift = 0;
  }

  [[nodiscard]] DeviceInfo device() const { return SimDevice(draw_.spec, sim_options()).info(); }

  [[nodiscard]] CalibrationResult calibrate() const {
    SimDevice device(draw_.spec, sim_options());
    CalibrationOptions options;
    options.session.loop.limits.max_velocity = kMaxVelocity;
    return haptrace::calibrate(device, options, stop_);
  }

  [[nodiscard]] EnsembleTrial run(const PlayOptions& controller) const {
    EnsembleTrial trial;
    for (const Path& path : options_.paths) {
      EnsembleRun run;
      const PlayResult result = play_on<RunSink>(draw_.spec, path, controller, run);
      run.measured_rms_error = result.last.rms_error;
      run.measured_peak_error = result.last.peak_error;
      run.force_ripple = result.last.force_ripple;
      run.max_force = result.last.max_force;
      trial.runs.push_back(run);
    }
    PlayOptions hold = controller;
    hold.learn = 0;
    hold.playback.repetitions = 1;
    hold.playback.hold = kHold;
    (void)play_on<HoldSink>(quiet_, hold_path(), hold, trial.hold);
    return trial;
  }

  [[nodiscard]] EnsembleOverdrive overdrive() const {
    PlayOptions controller = plain(beyond_gains());
    controller.playback.hold = kOverdriveHold;
    EnsembleOverdrive overdrive;
    (void)play_on<OnsetSink>(quiet_, hold_path(), controller, overdrive);
    return overdrive;
  }

 private:
  [[nodiscard]] SimOptions sim_options() const { return {.name = draw_.spec.model, .seed = draw_.noise_seed}; }

  /// Runs a session on a new device with a Sink that writes into `result`.
  template <class Sink, class Result>
  PlayResult play_on(const SimSpec& spec, const Path& path, PlayOptions options, Result& result) const {
    SimDevice device(spec, sim_options());
    const double limit = options.session.loop.limits.max_force;
    Sink sink(
        {device, spec, options.session.loop.rate_hz, limit > 0 ? std::min(limit, spec.strongest()) : spec.strongest()});
    options.sinks.push_back(&sink);
    PlayResult played = play(device, plan_playback(device.info(), path, options), options, stop_);
    result.cause = played.session.servo.cause;
    sink.write(result);
    return played;
  }

  /// Returns gains beyond the stability limit of a free device: K < (b + B) / (T / 2 + t_d), Gil, Avello, Rubio and
  /// Florez 2004, with T / 2 of its hold and a lag counted as a delay.
  [[nodiscard]] PdGains beyond_gains() const {
    const SimSpec& s = draw_.spec;
    const double lag = 1 / (2 * std::numbers::pi * s.actuator_bandwidth_hz);
    const double late = 0.5 / PlaybackOptions{}.rate_hz + s.delay + lag;
    return gains(std::min(options_.beyond * (s.viscous.mean() + kOverdriveDamping) / late, kLargestKp),
                 kOverdriveDamping);
  }

  EnsembleDraw draw_;
  SimSpec quiet_;  ///< with a passive hand
  const EnsembleOptions& options_;
  const StopRequest& stop_;
};

const PdGains kStiff = stiff_gains(), kCautious = gains(500, 6);

EnsembleOptions completed(EnsembleOptions options) {
  check_draws(options.draws);
  if (options.kinds.empty()) throw input_error("an ensemble needs at least one kind of device");
  if (options.learn < 0 || options.learn > 100)
    throw input_error(fmt::format("the number of learning repetitions is {}; it must be from 0 to 100", options.learn));
  if (!(options.beyond >= 0.01 && options.beyond <= 100))
    throw input_error(
        fmt::format("the factor on the gains of a stable loop is {}; it must be from 0.01 to 100", options.beyond));
  if (options.paths.empty()) options.paths = ensemble_paths();
  return options;
}

}  // namespace

const char* to_string(EnsembleController controller) noexcept {
  static constexpr EnumNames<EnsembleController, 3> kNames{"controller", {"stiff", "cautious", "calibrated"}};
  return kNames.name(controller);
}

std::vector<Path> ensemble_paths() {
  return {make_shape("circle", {.size = 0.08, .duration = 4}), make_shape("square", {.size = 0.1, .duration = 8}),
          make_shape("script", {.size = 0.108, .duration = 6})};
}

double EnsembleOverdrive::delay() const noexcept {
  if (!oscillates()) return kNaN;
  return std::isfinite(caught) ? std::max(0.0, caught - onset) : std::numeric_limits<double>::infinity();
}

bool EnsembleMember::beyond_force(std::size_t path) const noexcept {
  const EnsembleRun& run = trial(calibrated() ? EnsembleController::calibrated : EnsembleController::stiff).runs[path];
  return run.overpowered() && run.needed_force > run.available_force;
}

EnsembleMember run_member(std::uint64_t seed, std::uint64_t index, const EnsembleOptions& options,
                          const StopRequest& stop) {
  EnsembleMember member{.index = index, .kind = options.kinds[index % options.kinds.size()]};
  const PathTrials trials(seed, index, member.kind, options, stop);
  const auto run = [&](EnsembleController controller, const PlayOptions& play_options) {
    if (stop.count() == 0) member.trials[static_cast<std::size_t>(controller)] = trials.run(play_options);
  };
  // A hand yields from one repetition to the next: only the same repetition compares.
  PlayOptions stiff = plain(kStiff);
  stiff.playback.repetitions = std::max(1, options.learn);
  run(EnsembleController::stiff, stiff);
  run(EnsembleController::cautious, plain(kCautious));
  member.overdrive = trials.overdrive();
  const CalibrationResult calibration = trials.calibrate();
  if (!calibration.succeeded()) {
    member.calibration_error = calibration.reason;
    return member;
  }
  PlayOptions calibrated = plain(kStiff);
  calibrated.gains.reset();
  calibrated.identified = calibration.identified();
  (void)bound_by_motors(calibrated.session, trials.device(), calibration.identification.plant);
  calibrated.law = options.law;
  calibrated.firmness = options.firmness;
  calibrated.learn = options.learn;
  calibrated.playback.repetitions = std::max(1, options.learn);
  run(EnsembleController::calibrated, calibrated);
  return member;
}

EnsembleOverdrive run_overdrive(std::uint64_t seed, std::uint64_t index, const EnsembleOptions& options,
                                const StopRequest& stop) {
  return PathTrials(seed, index, options.kinds[index % options.kinds.size()], options, stop).overdrive();
}

EnsembleReport run_ensemble(const EnsembleOptions& asked, const StopRequest& stop,
                            const std::function<void(const EnsembleProgress&)>& progress) {
  const EnsembleOptions options = completed(asked);
  EnsembleReport report{.kinds = options.kinds, .seed = options.seed, .draws = options.draws, .learn = options.learn};
  // A path that no device of the ensemble could play is rejected before the first draw runs.
  const SimDevice any(draw_device(options.seed, options.first).spec);
  for (const Path& path : options.paths) {
    if (const PlayPlan plan = plan_playback(any.info(), path, plain(kStiff)); !plan.stretch.is_identity())
      throw input_error(
          fmt::format("{} is too fast for the velocity limit: a playback would stretch its time, and the results would "
                      "be those of another path; give a slower one",
                      path.name));
    report.paths.push_back(path.name);
  }

  report.members = run_draws<EnsembleMember>(
      options.draws, options.threads, stop,
      [&](std::size_t draw) { return run_member(options.seed, options.first + draw, options, stop); }, progress);
  return report;
}

}  // namespace haptrace
