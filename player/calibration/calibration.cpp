#include "player/calibration/calibration.h"

#include "control/design/cogging_fit.h"
#include "control/design/hand_noise.h"
#include "control/design/identification.h"
#include "control/design/inertia_identification.h"
#include "devices/loop/servo_loop.h"
#include "player/calibration/calibration_controller.h"
#include "player/calibration/calibration_log.h"
#include "player/calibration/calibration_plan.h"
#include "player/calibration/calibration_trials.h"
#include "player/calibration/hand_listening.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <span>
#include <utility>
#include <vector>

namespace haptrace {
namespace {

// Constants of the second, gentler session.
constexpr double kMostUnseen = 0.4;  // largest share of the force that the movement so far may leave unexplained
constexpr double kHeavy = 1;         // mass from which the velocity is low-passed further [kg]
constexpr const char* kGentleVelocity = "lowpass:30";

/// Share of the usual ripple that LQG laws for a coarse model use. Within a backlash, the loop's gain is larger than
/// the model says, and laws with the usual ripple vibrated in the trials of every second such device.
constexpr double kCoarseRipple = 0.7;

/// Returns why the session yields no design. `step`: position resolution [m], see position_quantum().
std::string reason_of(const CalibrationController& controller, const SessionResult& session, double step) {
  const char axis = "xyz"[controller.axis()];
  switch (controller.verdict()) {
    case CalibrationController::Verdict::blocked:
      return fmt::format(
          "the device hardly moves in {}: something blocks it, or its friction exceeds the permitted force; hold it "
          "loosely, or allow more force",
          axis);
    case CalibrationController::Verdict::wrong_way:
      return fmt::format(
          "a force in {} does not move the device in {} like a mass: the driver's axes have the wrong order or signs, "
          "the hand holds so light a device too firmly, or the mechanism resonates below 50 Hz; check the axes, and "
          "calibrate while the device is free",
          axis, axis);
    case CalibrationController::Verdict::unclear:
      if (const double seen = controller.amplitude(); seen < step)
        return fmt::format(
            "the encoder resolution is too coarse for the excitation: in {} the device moves by {:.3f} mm, and the "
            "position resolution is {:.3f} mm; allow more force (--force-share, --max-force), or set the gains "
            "yourself (play --kp, --kd)",
            axis, 1e3 * seen, 1e3 * step);
      return fmt::format(
          "the hand moved the device in {} more than the excitation did, so the response to the excitation is hidden "
          "by a tremor or a voluntary movement; calibrate while the device is free or the hand rests, or "
          "allow more force (--force-share, --max-force)",
          axis);
    case CalibrationController::Verdict::deviation:
      return "the device did not follow the calibration movement (" + session.servo.detail +
             "): hold it loosely and let it move; if the device was free, check the signs of the driver's axes";
    case CalibrationController::Verdict::none:
      break;
  }
  return session.servo.detail;
}

/// One calibration of a device: its sessions, and what they yield.
class CalibrationRun {
 public:
  /// Borrows everything. Throws what plan_calibration throws.
  CalibrationRun(Device& device, const CalibrationOptions& options, const StopRequest& stop, const Progress& progress)
      : device_(device),
        options_(options),
        stop_(stop),
        progress_(progress),
        plan_(plan_calibration(device.info(), options)) {}

  CalibrationResult run() {
    bool finished = measure();
    if (hidden_by_tremor()) finished = measure_longer();
    const StopCause cause = result_.session.servo.cause;
    if (cause == StopCause::interrupted || cause == StopCause::device_lost) return std::move(result_);
    if (finished && led_by_the_hand()) return std::move(result_);
    if (finished) {
      if (responds_like_a_mass()) {
        design();
        return std::move(result_);
      }
    } else if (controller_->verdict() == CalibrationController::Verdict::none || !measured_again() ||
               led_by_the_hand()) {
      return std::move(result_);
    }
    if (!result_.identification.fits) {
      result_.reason = result_.doubt + "; " + result_.identification.reason;
      return std::move(result_);
    }
    try_designs(device_, plan_, options_.session, stop_, progress_, result_);
    if (result_.design) result_.design->tremor = options_.session.loop.tremor;
    if (result_.design && options_.places && (!options_.laws || search_laws({})))
      try_laws(device_, plan_, reached_, options_, stop_, progress_, result_);
    else if (!result_.reason.empty())
      result_.design.reset();
    return std::move(result_);
  }

 private:
  /// Returns the number of rows to keep of a session.
  [[nodiscard]] std::size_t rows() const {
    constexpr double kSpare = 20;  // for the approach to the centre and a second look [s]
    return static_cast<std::size_t>((plan_.duration + kSpare) * plan_.rate_hz);
  }

  /// Runs the session of the plan and identifies a full model. Returns true if the session came to its end.
  bool measure() {
    controller_.emplace(plan_);
    log_.emplace(*controller_, rows());
    if (!measured(*controller_, *log_, options_.session)) return false;
    take_model(identify(log_->experiment(plan_)));
    return true;
  }

  /// Returns true if there is no full model, but a vibration that a hand may cause was noticed, and the hand trembles
  /// when it moves the device alone. The tremor is then known to what follows. Softened for it, the feedback hardly
  /// moves the device, and the response to ten seconds of excitation disappears in it.
  [[nodiscard]] bool hidden_by_tremor() {
    const ServoReport& servo = result_.session.servo;
    const bool ended = servo.cause == StopCause::finished || servo.cause == StopCause::deviation;
    if (result_.identification.fits || !ended || servo.vibration.steps[static_cast<int>(VibrationRule::slow)] == 0)
      return false;
    const Vec3 mass = identify_coarsely(log_->whole(plan_)).plant.mass;
    constexpr double kLightest = 0.02, kHeaviest = 3;  // [kg]
    Vec3 likely = Vec3::Zero();
    for (int axis = 0; axis < 3; ++axis)
      if (mass[axis] > 0) likely[axis] = std::clamp(mass[axis], kLightest, kHeaviest);
    tell(
        fmt::format("something sways, the hand or the loop: no force for {:.0f} s, to listen to the hand", kListening));
    const Listened heard = listen_to_hand(device_, plan_, likely, options_.session, stop_, progress_);
    if (heard.ended == StopCause::interrupted || heard.ended == StopCause::device_lost) {
      end_early(heard.ended, "the calibration ended while it listened to the hand", result_);
      return false;
    }
    if (heard.held.noise.tremor == 0) return false;
    options_.session.loop.tremor = answer_to_tremor(heard.held);
    tremor_ = heard.held.noise;
    return true;
  }

  /// Measures as with `full`. Returns true if the session came to its end.
  [[nodiscard]] bool measure_longer() {
    lengthen(plan_);
    tell(fmt::format("the hand trembles: measuring again, for about {:.0f} s", plan_.duration));
    SessionResult before = std::move(result_.session);
    options_.session.recording.reset();
    const bool finished = measure();
    take_from(std::move(before));
    result_.session.warn(
        Severity::warning, "tremor",
        fmt::format("the hand trembles with about {:.1f} N rms at {:.0f} Hz, which hid the device: the calibration let "
                    "it move the device without force for {:.0f} s, and {} a longer measurement, which is not recorded",
                    tremor_.tremor, tremor_.tremor_hz, kListening, finished ? "then made" : "then began"));
    return finished;
  }

  /// Shows a remark at once.
  void tell(std::string text) const {
    if (!progress_) return;
    SessionView view;
    view.warnings.push_back({Severity::note, "calibration", kNaN, std::move(text)});
    progress_(view);
  }

  /// Keeps what belongs to the first session of a calibration, and the warnings of all.
  void take_from(SessionResult before) {
    result_.session.recording = before.recording;
    result_.session.recording_error = std::move(before.recording_error);
    std::vector<Warning>& warnings = result_.session.warnings;
    warnings.insert(warnings.begin(), before.warnings.begin(), before.warnings.end());
  }

  /// Runs a session. Returns true if it came to its end.
  [[nodiscard]] bool measured(CalibrationController& controller, CalibrationLog& log, const SessionOptions& session) {
    SampleSink* const sinks[] = {&log};
    result_.session = run_session(device_, controller, {.reference = true}, sinks, session, stop_, progress_);
    result_.reason = result_.session.servo.cause != StopCause::finished
                         ? reason_of(controller, result_.session, position_quantum(log.whole(plan_).rows))
                         : std::string();
    if (!result_.reason.empty()) return false;
    take_motors(log);
    reached_ = log.experiment(plan_).places;
    return true;
  }

  /// Returns true if the session took more force than the motors bear for long, and sets the reason. The places are
  /// then not reached, and the hand's pull is taken for the device's gravity. In relaxed hands, sessions took up to 0.9
  /// of the continuous force, and in hands that moved or stayed elsewhere 1.1 to 1.5.
  [[nodiscard]] bool led_by_the_hand() {
    constexpr double kMostPull = 1.1;  // of the continuous force
    const double borne = ServoLoop::in_force(device_.info(), options_.session.loop.limits).max_continuous_force;
    const std::span<const TickRow> rows = log_->whole(plan_).rows;
    double squares = 0;
    for (const TickRow& row : rows) squares += row.force.squaredNorm();
    const double taken = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(rows.size(), 1)));
    if (!(borne > 0) || taken <= kMostPull * borne) return false;
    result_.reason = fmt::format(
        "the calibration took {:.1f} N rms, and the motors bear {:.1f} N for long: the hand moved, or held the device "
        "back. Hold it loosely, let it lead the hand, and calibrate again",
        taken, borne);
    return true;
  }

  /// Finds the force of the motors. If it is below what was asked of them, gives the rows the force that acted, and
  /// bounds all that follows.
  void take_motors(CalibrationLog& log) {
    const MotorLimit& motors = result_.motors = identify_motor_limit(log.experiment(plan_));
    if (!(motors.force > 0)) return;
    log.shorten(motors.force);
    result_.session.warn(Severity::warning, "motor_limit",
                         fmt::format("the motors gave at most {:.2f} +- {:.2f} N of the {:.2f} N that were sent: they "
                                     "saturate below the force that the device states. Sessions with this profile "
                                     "send no more",
                                     motors.force, motors.half_width, motors.tried));
    plan_.device_force = std::min(plan_.device_force, motors.force);
    plan_.max_force = std::min(plan_.max_force, motors.force);
  }

  void take_model(Identification identified) {
    identified.plant.motor_limit = result_.motors.force;
    identified.half_width.motor_limit = result_.motors.half_width;
    result_.identification = std::move(identified);
  }

  /// Takes the delay of the model with a hand if it is much shorter. To the model without a hand and links, a device
  /// that swings within the lines seems late.
  void take_delay(const HeldIdentification& seen) {
    constexpr double kMuch = 2e-3;  // [s]
    const double delay = seen.held.delay + seen.held.lag;
    if (!seen.held.held() || result_.identification.plant.delay - delay < kMuch) return;
    result_.identification.plant.delay = delay;
    result_.identification.half_width.delay = seen.half_width.lag;
  }

  /// Returns what `see` makes of the last session, without the force of the identified cogging.
  template <class See>
  auto with_experiment(const See& see) const {
    Experiment experiment = log_->experiment(plan_);
    std::vector<TickRow> rows;
    if (const PlantModel& plant = result_.identification.plant; plant.cogging) {
      rows = without_cogging(experiment, *plant.cogging, plant.delay);
      experiment.rows = rows;
    }
    return see(experiment);
  }

  /// Returns true if the full model fits. If not, makes a coarse model.
  [[nodiscard]] bool responds_like_a_mass() {
    // With backlash and cables, a model may fit by chance. The unexplained fraction of the response then was at least
    // 0.31. On 72 random devices without backlash or a tremor, it was at most 0.23. A tremor makes it as large, but its
    // force does not repeat over the place.
    constexpr double kDoubtful = 0.3;
    const Experiment experiment = log_->experiment(plan_);
    Identification& full = result_.identification;
    if (full.fits && (full.line_residual < kDoubtful || !find_cogging(experiment, full.plant.delay))) return true;
    Identification coarse = identify_coarsely(experiment);
    if (full.fits && !(coarse.fits && coarse.plant.cogging)) return true;
    result_.doubt = full.fits
                        ? fmt::format(
                              "the model does not explain {:.0f} % of the response to the excitation, and there are "
                              "forces that repeat over the place",
                              100 * full.line_residual)
                        : full.reason;
    take_model(std::move(coarse));
    return false;
  }

  /// Designs the laws for a full model, and tries them.
  void design() {
    const HeldIdentification seen = with_experiment(
        [&](const Experiment& experiment) { return identify_held(experiment, result_.identification); });
    take_delay(seen);
    result_.design =
        design_tracking(result_.identification.plant, {.rate_hz = plan_.rate_hz, .max_force = plan_.device_force});
    if (options_.laws && search_laws(seen) && options_.places)
      try_laws(device_, plan_, reached_, options_, stop_, progress_, result_);
  }

  /// Sets the delay of the model of a device that is known only coarsely. While a law holds the device, its force
  /// follows from the position without delay, which makes the coarse delay too small, and backlash makes it too large.
  /// On random devices with a delay of 3.5 ms and all else that makes a model coarse, a law for 1 ms less or more
  /// follows as well, and one for 4 ms more half as well.
  static void take_likely_delay(HeldModel& model) {
    constexpr double kShortest = 3e-3, kLongest = 4.5e-3;  // [s]
    model.delay = std::clamp(model.delay + model.lag, kShortest, kLongest) - model.lag;
  }

  /// Searches the LQG laws for the device in the hand that was `seen`. Returns false if the user interrupts it, and
  /// then ends the calibration.
  [[nodiscard]] bool search_laws(const HeldIdentification& seen) {
    const Identification& identified = result_.identification;
    HeldDevice held = held_device(identified, seen, plan_.rate_hz, plan_.device_force);
    if (identified.coarse) {
      take_likely_delay(held.model);
      held.ripple *= kCoarseRipple;
    }
    with_experiment([&](const Experiment& experiment) {
      // A coarse model does not tell a hand's force from what it leaves unexplained.
      expect_tremor(identified.coarse ? HandNoiseIdentification{.noise = tremor_}
                                      : identify_hand_noise(experiment, held.model, identified.plant),
                    plan_.device_force, held);
      held.inertia = identify_inertia(experiment, identified);
      held.one_mass = plan_.places.empty() || experiment.places.size() < plan_.places.size();
    });
    if (!design_laws(held, plan_.rate_hz, stop_, options_.searching)) {
      end_early(StopCause::interrupted, "interrupted while laws were searched", result_);
      return false;
    }
    result_.held.emplace(std::move(held));
    return true;
  }

  /// Runs a gentler session, with the mass that the first one showed before it ended early, and makes a coarse model of
  /// it. Returns false if there is none.
  [[nodiscard]] bool measured_again() {
    const Identification seen = identify_coarsely(log_->whole(plan_));
    if (!seen.fits || seen.line_residual > kMostUnseen) return false;
    result_.doubt = fmt::format("the device has a mass of about {:.2f} kg and could not be excited: {}",
                                seen.plant.mass.maxCoeff(), result_.reason);
    SessionOptions gentle = options_.session;
    if (seen.plant.mass.maxCoeff() > kHeavy) gentle.velocity = kGentleVelocity;
    gentle.recording.reset();
    SessionResult before = std::move(result_.session);
    log_.reset();
    controller_.emplace(plan_, seen.plant.mass);
    log_.emplace(*controller_, rows());
    const bool finished = measured(*controller_, *log_, gentle);
    take_from(std::move(before));
    if (finished) take_model(identify_coarsely(log_->experiment(plan_)));
    return finished;
  }

  Device& device_;
  CalibrationOptions options_;
  const StopRequest& stop_;
  const Progress& progress_;
  CalibrationPlan plan_;
  std::optional<CalibrationController> controller_;
  std::optional<CalibrationLog> log_;
  HandNoise tremor_;                      ///< that hid the device
  std::vector<ExperimentPlace> reached_;  ///< in the last session that came to its end
  CalibrationResult result_;
};

}  // namespace

CalibrationResult calibrate(Device& device, const CalibrationOptions& given, const StopRequest& stop,
                            const Progress& progress) {
  // The motors stay warm between the sessions of a calibration.
  CalibrationOptions options = given;
  MotorHeat motors;
  if (options.session.loop.motors == nullptr) options.session.loop.motors = &motors;
  return CalibrationRun(device, options, stop, progress).run();
}

}  // namespace haptrace
