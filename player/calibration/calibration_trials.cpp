#include "player/calibration/calibration_trials.h"

#include "control/pd.h"
#include "devices/loop/servo_loop.h"
#include "player/calibration/law_trial.h"
#include "player/calibration/workspace_trial.h"
#include "player/record.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <optional>
#include <span>
#include <utility>

namespace haptrace {
namespace {

/// Tries the laws at the centre and at places that the device reached before, and notes in the result what came of it.
class LawTrials {
 public:
  /// Borrows everything but the places.
  LawTrials(Device& device, const CalibrationPlan& plan, const std::vector<ExperimentPlace>& places,
            const CalibrationOptions& options, const StopRequest& stop, const Progress& progress,
            CalibrationResult& result)
      : device_(device),
        plan_(plan),
        options_(options),
        stop_(stop),
        progress_(progress),
        result_(result),
        tour_{.places = {plan.centre},
              .radius = plan.swing_size(),
              .speed = plan.max_speed,
              .max_deviation = plan.max_deviation,
              .small_oscillations = !result.identification.coarse,
              .session = options.session},
        most_ripple_(most_ripple(plan.device_force, result.identification.coarse)) {
    const auto farthest = std::span(plan.places).subspan(plan.nearer_places);
    for (const ExperimentPlace& place : places)
      if (std::ranges::find(farthest, place.position) != farthest.end()) tour_.places.push_back(place.position);
    tour_.session.loop.limits.max_force = plan.max_force;
  }

  /// A law that fails is designed again for a mass that differs more; if that fails too, the softer ones are tried.
  /// Returns early if the user or the device ends it.
  void run() {
    judge_laws();
    compare();
  }

  /// Compares the laws for a coarse model with plain PD control. If none passes, plain PD control must stay calm, or
  /// there is no design. Returns early if the user or the device ends it.
  void run_coarse() {
    const bool passed_before = result_.design->verdict.refused.empty();
    if (!try_plain() || !feed_plain()) return;
    if (passed_before) {
      if (!judge_observer()) return;
      // Where its bandwidth had to be reduced, plain PD control that learns follows at least as well.
      refuse_unless_closer(result_.bandwidth < 1 ? kWorthwhile : 1, plain_, "plain PD control",
                           result_.design->verdict);
    }
    if (result_.held && !judge_coarse_lqg()) return;
    compare();
    if (passed_before || accepted_ || result_.design->plain_calm)
      result_.reason.clear();
    else
      result_.design.reset();
  }

 private:
  void judge_laws() {
    if (!try_plain() || !judge_firmness(Firmness::normal)) return;
    if (is_refused(Firmness::normal) && !result_.held->one_mass) {
      result_.held->one_mass = true;
      if (!redesign() || !judge_firmness(Firmness::normal)) return;
    }
    const bool refused = is_refused(Firmness::normal);
    if ((refused || options_.full) && !judge_firmness(Firmness::quiet)) return;
    if (options_.full && !judge_firmness(Firmness::exact)) return;
    if (!refused) return;
    refuse_unless_worthwhile(result_.held->design(Firmness::quiet).verdict);
    if (!is_refused(Firmness::quiet)) return;
    if (judge_observer()) refuse_unless_worthwhile(result_.design->verdict);
  }

  [[nodiscard]] static double most_ripple(double force, bool coarse) {
    return std::max(kMostRipple * force, coarse ? std::min(kMostCoarseRipple * force, kMostFelt) : 0.0);
  }

  /// Searches the LQG laws again. Returns false if the user interrupts it, and then ends the calibration.
  [[nodiscard]] bool redesign() {
    if (design_laws(*result_.held, plan_.rate_hz, stop_, options_.searching)) return true;
    end_early(StopCause::interrupted, "interrupted while laws were searched", result_);
    return false;
  }

  /// Judges the LQG law for a coarse model, and if it fails, one with less ripple. Playbacks prefer it to the law with
  /// an observer, so it must be closer. The quiet law is too soft for what the model leaves unknown. Returns false if
  /// the user or the device ended it.
  [[nodiscard]] bool judge_coarse_lqg() {
    const std::optional<TourResult> observer = std::exchange(accepted_, {});
    if (!judge_firmness(Firmness::normal)) return false;
    if (is_refused(Firmness::normal)) {
      result_.held->ripple *= kSofterRipple;
      if (!redesign() || !judge_firmness(Firmness::normal)) return false;
    }
    LawVerdict& verdict = result_.held->design(Firmness::normal).verdict;
    // A law that is hardly closer before plain PD control learns is less close afterwards.
    refuse_unless_closer(kClearly, plain_, "plain PD control", verdict);
    if (observer) refuse_unless_closer(1, *observer, "the law with an observer", verdict);
    if (!accepted_) accepted_ = observer;
    return true;
  }

  /// Refuses the law that was just accepted, for a coarse model, if it is not `least` times as accurate as `other`: at
  /// some place where the force sufficed, or over all places.
  void refuse_unless_closer(double least, const TourResult& other, const char* name, LawVerdict& verdict) {
    if (!verdict.refused.empty() || !other.finished()) return;
    const double at_place = least_improvement(*accepted_, other);
    const double over_all = whole_error(other) / whole_error(*accepted_);
    if (at_place > 0 && at_place < least)
      verdict.refused = fmt::format("its model is coarse, and at one place it is only {:.2f} times as accurate as {}",
                                    at_place, name);
    else if (over_all < least)
      verdict.refused =
          fmt::format("its model is coarse, and it is only {:.2f} times as accurate as {}", over_all, name);
    if (!verdict.refused.empty()) accepted_.reset();
  }

  /// Tries plain PD control with the feedforward of the model, if it was calm without it. If it is as calm and closer
  /// with it, laws are compared with that from then on. Returns false if the user or the device ended it.
  [[nodiscard]] bool feed_plain() {
    if (!result_.design->plain_calm) return true;
    law_.compensations.observer = false;
    const TourResult fed = tried();
    law_.compensations = PlayOptions{}.compensations;
    if (ended(fed)) return false;
    result_.design->plain_bare = !is_calm(fed, cogging_ripple()) || error_ratio(fed, plain_) > 1;
    if (!result_.design->plain_bare) plain_ = fed;
    return true;
  }

  static constexpr double kMostRipple = 0.04;  ///< share of the largest force
  /// Share of the largest force for a coarse model, up to kMostFelt if that is more than usual. Within a backlash,
  /// every stiff loop oscillates a little, and stiff PD control does so most. An oscillation that the guard does not
  /// report is therefore judged only by its ripple.
  static constexpr double kMostCoarseRipple = 0.15, kMostFelt = 1.5;  // [N]
  static constexpr double kSofterRipple = 0.7;  ///< ripple of the second LQG law for a coarse model
  static constexpr double kStiffMargin = 1.2;   ///< of plain PD control on the free device
  /// Stiffnesses that are tried, as shares of that of stiff PD control. After one that vibrates, half of it leaves a
  /// margin.
  static constexpr std::array kPlainShares{1.0, 0.5, 0.25};
  static constexpr double kWorthwhile = 2;  ///< least improvement of a law after another one was refused
  static constexpr double kClearly = 1.1;   ///< the same of an LQG law for a coarse model

  /// Waits until the motors have cooled so far that the tour has nearly the force that a playback has. The excitation
  /// and the pulses before have warmed them, and so has every tour.
  void cool() {
    constexpr double kWarm = 0.6;  // share of the continuous force, rms, that earlier forces may leave
    const MotorHeat* const motors = tour_.session.loop.motors;
    const SafetyLimits limits = ServoLoop::in_force(device_.info(), tour_.session.loop.limits);
    if (motors == nullptr || !(limits.max_continuous_force > 0)) return;
    const double excess = motors->force / std::pow(kWarm * limits.max_continuous_force, 2);
    if (excess <= 1) return;
    RecordOptions rest{.duration = limits.continuous_time * std::log(excess), .session = tour_.session};
    rest.session.recording.reset();
    rest.session.observer = nullptr;
    const Progress waits = [this](SessionView view) {
      view.warnings.clear();  // that the motors are warm
      if (progress_) progress_(view);
    };
    (void)record(device_, rest, stop_, waits);  // the tour notices why it ended early
  }

  [[nodiscard]] TourResult tried() {
    cool();
    law_.identified = result_.identified();
    return toured(device_, law_, tour_, stop_, progress_);
  }

  /// Returns true if the user or the device ended the tour, and then ends the calibration.
  [[nodiscard]] bool ended(const TourResult& toured) {
    const StopCause cause = toured.session.servo.cause;
    if (cause != StopCause::interrupted && cause != StopCause::device_lost) return false;
    end_early(cause, "the trial of the laws ended early: " + toured.session.servo.detail, result_);
    return true;
  }

  /// Tries plain PD control, with which the laws are compared: stiff PD control, since no law may be worse than that,
  /// then softer gains until the device stays calm. Returns false if the user or the device ended it.
  [[nodiscard]] bool try_plain() {
    law_.compensations = {};
    bool tried_any = false;
    for (const double share : kPlainShares) {
      const PdGains stiff = stiff_gains(), gains{share * stiff.kp, std::sqrt(share) * stiff.kd};
      const bool last = share == kPlainShares.back() && !tried_any;
      if (!last && !is_stable(lightest(), gains, kStiffMargin, plan_.rate_hz)) continue;
      tried_any = true;
      result_.design->plain = gains;
      plain_ = tried();
      if (ended(plain_)) return false;
      result_.design->plain_calm = is_calm(plain_);
      if (result_.design->plain_calm) break;
      if (share == 1) stiff_ = plain_;
    }
    law_.compensations = PlayOptions{}.compensations;
    return true;
  }

  /// `known_ripple` is that of the force that is fed forward [N].
  [[nodiscard]] bool is_calm(const TourResult& toured, double known_ripple = 0) const {
    return toured.finished() && toured.oscillations == 0 &&
           std::ranges::max(toured.ripple) <= std::hypot(most_ripple_, known_ripple);
  }

  /// Returns the identified device as it is where its mass is smallest.
  [[nodiscard]] PlantModel lightest() const {
    PlantModel plant = result_.identification.plant;
    // To a coarse model, friction and backlash look like a delay.
    constexpr double kMostDelay = 3e-3;  // [s]
    if (result_.identification.coarse) plant.delay = std::min(plant.delay, kMostDelay);
    if (result_.held && result_.held->inertia)
      plant.mass = plant.mass.cwiseProduct(result_.held->inertia->range().first);
    return plant;
  }

  /// Tries the law and sets its verdict. Returns false if the user or the device ended it.
  [[nodiscard]] bool judge(double predicted_ripple, LawVerdict& verdict) {
    const TourResult toured = tried();
    if (ended(toured)) return false;
    verdict = {.tried = true,
               .improvement = plain_.finished() && toured.finished() ? least_improvement(toured, plain_) : 0,
               .refused = refusal_of(toured, plain_, tour_,
                                     std::hypot(std::max(2 * predicted_ripple, most_ripple_), cogging_ripple())),
               .since = {},
               .force = toured.force};
    const bool may_be_chosen = law_.firmness != Firmness::exact;
    if (verdict.refused.empty() && may_be_chosen && !accepted_) accepted_ = toured;
    return true;
  }

  /// Compares what a playback chooses now with plain PD control: if it is that, with the feedforward of the model,
  /// which may be a bad one, and if stiff PD control was not calm, with that. Returns early if the user or the device
  /// ends it.
  void compare() {
    if (!result_.design || !plain_.finished()) return;
    const auto passed = [](const LawVerdict& verdict) { return verdict.tried && verdict.refused.empty(); };
    const bool any =
        passed(result_.design->verdict) || (result_.held && (passed(result_.held->design(Firmness::normal).verdict) ||
                                                             passed(result_.held->design(Firmness::quiet).verdict)));
    if (!any && !result_.identification.coarse && !feed_plain()) return;
    if (!stiff_ || !stiff_->finished()) return;
    result_.design->stiff_error = error_ratio(*stiff_, any && accepted_ ? *accepted_ : plain_);
    for (const double ripple : stiff_->ripple)  // NaN at a place that it did not reach
      if (std::isfinite(ripple)) result_.design->stiff_ripple = std::max(result_.design->stiff_ripple, ripple);
  }

  /// Returns the rms of the force that compensates for cogging while the device moves [N].
  [[nodiscard]] double cogging_ripple() const {
    double squares = 0;
    if (const auto& cogging = result_.identification.plant.cogging)
      for (const CoggingWave& wave : cogging->waves) squares += 0.5 * std::pow(wave.amplitude(), 2);
    return std::sqrt(squares);
  }

  /// Judges the LQG law of this firmness, as judge() does.
  [[nodiscard]] bool judge_firmness(Firmness firmness) {
    law_.law = TrackingLaw::lqg;
    law_.firmness = firmness;
    LqgDesign& design = result_.held->design(firmness);
    // The law follows the mass, and so does its ripple.
    return judge(result_.held->mass_range().second.maxCoeff() * design.figures.ripple, design.verdict);
  }

  /// Judges the law with an observer, as judge() does.
  [[nodiscard]] bool judge_observer() {
    law_.law = TrackingLaw::observer;
    law_.firmness.reset();
    // If the user or the device ends the trial, the design is gone, and its verdict with it.
    LawVerdict verdict;
    const bool judged = judge(result_.design->ripple, verdict);
    if (judged) result_.design->verdict = verdict;
    return judged;
  }

  /// Refuses a law that is less than kWorthwhile times as accurate as plain PD control at some place, after another one
  /// was refused: plain PD control that learns follows at least as well there.
  void refuse_unless_worthwhile(LawVerdict& verdict) {
    if (!verdict.refused.empty() || !(verdict.improvement > 0) || verdict.improvement >= kWorthwhile) return;
    verdict.refused =
        fmt::format("another one was refused, and at one place it is only {:.2f} times as accurate as plain PD control",
                    verdict.improvement);
    accepted_.reset();
  }

  [[nodiscard]] bool is_refused(Firmness firmness) const {
    return !result_.held->design(firmness).verdict.refused.empty();
  }

  Device& device_;
  const CalibrationPlan& plan_;
  const CalibrationOptions& options_;
  const StopRequest& stop_;
  const Progress& progress_;
  CalibrationResult& result_;
  WorkspaceTour tour_;
  double most_ripple_;  ///< [N]
  PlayOptions law_;
  TourResult plain_;                    ///< of plain PD control
  std::optional<TourResult> stiff_;     ///< of stiff PD control, if it was not calm
  std::optional<TourResult> accepted_;  ///< of the law that passed and that playbacks choose
};

}  // namespace

void end_early(StopCause cause, const std::string& reason, CalibrationResult& result) {
  result.session.servo.cause = cause;
  result.session.servo.detail = result.reason = reason;
  result.design.reset();
  result.held.reset();
}

void try_designs(Device& device, const CalibrationPlan& plan, const SessionOptions& session, const StopRequest& stop,
                 const Progress& progress, CalibrationResult& result) {
  constexpr std::array kBandwidths{1.0, 0.7, 0.5, 0.35};
  LawTrialOptions options{.centre = plan.centre,
                          .radius = plan.swing_size(),
                          .speed = plan.max_speed,
                          .max_deviation = plan.max_deviation,
                          .session = session};
  // The speed on the circle, including its vertical movement at twice the frequency, stays within what the force
  // allows.
  const double acceleration =
      CalibrationPlan::kInertiaShare * plan.max_force / result.identification.plant.mass.maxCoeff();
  options.speed = std::min(options.speed, std::sqrt(acceleration * options.radius / std::sqrt(5.0)));
  options.session.loop.limits.max_force = plan.max_force;
  for (const double bandwidth : kBandwidths) {
    TrackingDesign design = design_tracking(
        result.identification.plant, {.rate_hz = plan.rate_hz, .max_force = plan.device_force, .bandwidth = bandwidth});
    // A trial shows stability only up to its own gains.
    design.largest = {(kTrialRaise * design.gains.kp).cwiseMin(kLargestKp),
                      (kTrialRaise * design.gains.kd).cwiseMin(kLargestKd)};
    const LawTrial trial = try_out(device, {result.identification.plant, design}, options, stop, progress);
    ++result.trials;
    design.verdict.refused = trial.reason;
    result.bandwidth = trial.passed() ? bandwidth : 0;
    result.design = std::move(design);
    if (trial.passed()) return result.reason.clear();
    result.reason =
        fmt::format("{}; the trial of a control law for a coarse model failed: {}", result.doubt, trial.reason);
    const StopCause cause = trial.session.servo.cause;
    if (cause == StopCause::interrupted || cause == StopCause::device_lost) {
      result.session.servo.cause = cause;
      result.session.servo.detail = trial.session.servo.detail;
      return result.design.reset();
    }
  }
}

void try_laws(Device& device, const CalibrationPlan& plan, const std::vector<ExperimentPlace>& places,
              const CalibrationOptions& options, const StopRequest& stop, const Progress& progress,
              CalibrationResult& result) {
  LawTrials trials(device, plan, places, options, stop, progress, result);
  if (result.identification.coarse)
    trials.run_coarse();
  else
    trials.run();
}

}  // namespace haptrace
