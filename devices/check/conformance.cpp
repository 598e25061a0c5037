#include "devices/check/conformance.h"

#include "base/error.h"
#include "base/statistics.h"
#include "base/units.h"
#include "control/velocity_estimator.h"
#include "devices/check/conformance_probe.h"
#include "devices/loop/watchdog.h"

#include <algorithm>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <utility>

namespace haptrace {
namespace {

struct Law {
  const char* id;
  const char* sentence;
};

constexpr Law kLaws[] = {
    {"description", "describes itself consistently"},
    {"ready", "becomes ready for forces"},
    {"measures", "measures exactly the quantities that it states"},
    {"exchange", "completes its exchanges within a tick"},
    {"rate", "provides a new state for nearly every tick"},
    {"fresh", "answers with recent states"},
    {"noise", "measures a position with little noise at rest"},
    {"follows", "measures the position of its handle"},
    {"gentle", "moves slowly, and by a short distance, under small forces"},
    {"force_x", "moves along x under a force along x"},
    {"force_y", "moves along y under a force along y"},
    {"force_z", "moves along z under a force along z"},
    {"latency", "responds to a force without a long delay"},
    {"resolution", "measures positions with the stated resolution"},
    {"opposes", "opposes the hand when a spring is commanded"},
    {"stated_force", "produces the force that it states"},
    {"nan_force", "treats a force that is not finite as zero"},
    {"host_pause", "removes its force when the host pauses"},
    {"finite", "answers with finite positions"},
    {"stays", "stays connected while it is used"},
    {"closes", "reports that it is lost after it is closed"},
    {"reopens", "can be opened again after it is closed"},
    {"repeats", "answers identical commands identically, in virtual time"},
};

constexpr const char* kAxisLaws[] = {"force_x", "force_y", "force_z"};

constexpr double kLate = 0.01, kLateBusy = 0.5;           // largest share of exchanges that last longer than a tick
constexpr double kNewStates = 0.8, kNewStatesBusy = 0.1;  // least share of ticks with a new state
constexpr std::int64_t kOneState = 20000;                 // times closer than this belong to one state [ns]
constexpr double kStale = 0.01, kStaleBusy = 0.05;        // largest median age [s]
constexpr double kLoud = 1e-4;                            // largest noise without a stated resolution [m]
constexpr double kLoudCounts = 3;                         // largest noise over the stated resolution
constexpr double kCoarser = 3, kFiner = 10;               // tolerated factors between stated and real resolution
constexpr std::size_t kLeastSteps = 10;                   // least number of steps to judge a resolution
constexpr double kCreeps = 0.005;        // speed without force that hides the effect of a small force [m/s]
constexpr double kLeastResponse = 5e-4;  // smallest motion that shows a direction [m]
constexpr double kOwnMotion = 0.35;      // largest ratio of other motion to motion from the force
constexpr double kLightest = 0.01;       // no handle with its mechanism has less apparent mass [kg]
constexpr double kAligned = 0.7071;      // cosine of the widest angle between force and motion
constexpr double kSoon = 0.05;           // [s]
constexpr double kStrongest = 1000;      // largest force of a device that a hand can hold [N]
constexpr double kStrongestTurn = 100;   // [N m]
constexpr double kWidest = 10;           // largest coordinate of a workspace [m]
constexpr double kCoarsest = 0.01;       // position resolution [m]
constexpr double kFastestRate = 1e6;     // [Hz]
constexpr double kStiction = 3;          // largest friction of a haptic device [N]
constexpr double kMargin = 0.01;         // largest margin to the workspace's faces for a test force [m]
constexpr double kHeldPath = 0.002;      // least path under a held force [m]
constexpr double kLeastHeld = 0.02;      // first held force over the largest force, at least
constexpr double kHarder = 1.2;          // factor to the next held force, if the path was too short
constexpr int kLouder = 2;               // rounds with a larger force, if a hand hides its effect
constexpr double kLouderBy = 1.5;
constexpr double kShortestHold = 0.1;  // twice the time that a watchdog may take [s]
constexpr double kLetGo = 0.6;         // largest share of the path under a held force. A mass whose force ends
                                       // after 50 ms of 200 goes half of it; friction and a hand reduce that
constexpr const char* kOutside = "the handle is outside the workspace, or too close to its edge for a force to move it";
constexpr const char* kNoWatchdog =
    ": it keeps its last force. Its driver needs a watchdog that sends zero force after at most 50 ms without an "
    "exchange";
constexpr double kUnmoved = 1e-3;    // largest motion under a force that is not finite [m]
constexpr double kShortFade = 0.05;  // [s]

std::string distance_text(double metres) {
  return metres < 1e-5 ? fmt::format("{:.3g} um", 1e6 * metres) : fmt::format("{:.3g} mm", 1e3 * metres);
}

/// Results of a push along an axis.
struct Push {
  Vec3 response = Vec3::Zero();           ///< [m]
  double moving_force = kNaN;             ///< force at which the handle began to move [N]
  double reaching_force = kNaN;           ///< force at PushController::kReach, the smaller of two [N]
  double mass = kNaN, least_mass = kNaN;  ///< largest and least mass of two strokes, if only friction and mass act [kg]
  bool aligned = false;
};

/// A push that can be repeated.
struct FirstPush {
  int axis;
  double max_force, least_motion;
  std::vector<Exchanged> rows;
  [[nodiscard]] PushController controller(const DeviceInfo& device) const {
    return {device, axis, max_force, least_motion};
  }
};

/// Examines one device from its opening to the report.
class Examination {
 public:
  Examination(const std::function<std::unique_ptr<Device>()>& open, const ConformanceOptions& options,
              ConformanceUser& user, const StopRequest& stop)
      : open_(open),
        options_(options),
        user_(user),
        stop_(stop),
        device_(std::make_unique<ObservedDevice>(open())),
        info_(device_->info()) {
    report_.device = info_;
    options_.max_force = info_.max_force > 0 ? std::min(options_.max_force, info_.max_force) : options_.max_force;
  }

  ConformanceReport run() {
    describe_itself();
    watch_at_rest();
    try_forces();
    judge_whole();
    close_and_reopen();
    return conclude();
  }

 private:
  using Verdict = LawFinding::Verdict;

  [[nodiscard]] bool is_real() const { return !info_.virtual_time; }

  void tell(const std::string& id, Verdict verdict, const std::string& detail,
            const std::vector<LawFinding::Figure>& figures = {}) {
    const auto* const law = std::find_if(std::begin(kLaws), std::end(kLaws), [&](const Law& l) { return id == l.id; });
    report_.findings.push_back({id, law->sentence, verdict, detail, figures});
    user_.found(report_.findings.back());
  }
  void judge(const std::string& id, bool kept, const std::string& detail,
             const std::vector<LawFinding::Figure>& figures = {}) {
    tell(id, kept ? Verdict::passed : Verdict::failed, detail, figures);
  }
  void leave_out(const std::string& id, const std::string& why) { tell(id, Verdict::not_tested, why); }

  [[nodiscard]] bool is_told(const std::string& id) const {
    return std::any_of(report_.findings.begin(), report_.findings.end(),
                       [&](const LawFinding& f) { return f.id == id; });
  }

  /// Runs one session. Returns true if it ran to its end. An interruption, a loss or a position that is not finite also
  /// ends all further tests.
  bool session(Controller& controller, double seconds, bool with_force) {
    ServoOptions options{.rate_hz = options_.rate_hz,
                         .virtual_time = info_.virtual_time,
                         .realtime = options_.realtime,
                         .limits = {.max_force = options_.max_force,
                                    .max_velocity = with_force ? options_.max_velocity : 0,
                                    .soft_start = kShortFade,
                                    .release = kShortFade},
                         .ready_timeout = options_.ready_timeout};
    const auto estimator = make_velocity_estimator("lowpass:100", options_.rate_hz, info_.position_resolution);
    device_->observe(static_cast<std::size_t>(options_.rate_hz * (seconds + 0.5)));
    ServoLoop loop(*device_, controller, *estimator, {}, options);
    StopRequest stop(&stop_);
    const Watchdog watchdog({.pulse = device_->pulse(),
                             .device = *device_,
                             .stop = stop,
                             .keep = {},
                             .realtime = options.realtime && !options.virtual_time});
    last_ = loop.run(stop);
    device_->spoil(false);
    steps_.add(device_->rows());
    for (const Exchanged& row : device_->rows()) {
      not_finite_ = not_finite_ || !is_finite(row.state.position);
      if (!first_position_) first_position_ = row.state.position;
      moved_ = moved_ || row.state.position != *first_position_;
      wrong_age_ = wrong_age_ || !(row.state.age >= 0 && std::isfinite(row.state.age));
      ages_.record(static_cast<std::int64_t>(1e9 * std::clamp(row.state.age, 0.0, 1e3)));
    }
    switch (last_.cause) {
      case StopCause::finished:
        return true;
      case StopCause::interrupted:
        over_ = "the test was stopped earlier";
        report_.interrupted = true;
        break;
      case StopCause::device_lost:
        lost_ = true;
        over_ = "the device was lost earlier";
        break;
      case StopCause::not_finite:
        over_ = "an earlier position was not finite";
        break;
      default:
        break;
    }
    return false;
  }

  void describe_itself() {
    std::vector<std::string> wrong;
    const auto expect = [&wrong](bool right, std::string complaint) {
      if (!right) wrong.push_back(std::move(complaint));
    };
    expect(!info_.backend.empty(), "backend is empty");
    expect(!info_.model.empty() || info_.backend == "replay", "model is empty");
    expect(is_finite(info_.workspace_min) && is_finite(info_.workspace_max), "workspace is not finite");
    expect((info_.workspace_min.array() < info_.workspace_max.array()).all(),
           "workspace_min is not below workspace_max in every axis");
    expect(info_.workspace_min.cwiseAbs().maxCoeff() <= kWidest && info_.workspace_max.cwiseAbs().maxCoeff() <= kWidest,
           fmt::format("the workspace reaches farther than {} m; its unit is the metre", kWidest));
    expect(std::isfinite(info_.position_resolution) && info_.position_resolution >= 0,
           "position_resolution is negative or not finite");
    expect(!(info_.position_resolution > kCoarsest),
           fmt::format("position_resolution is {} m, which is too coarse for an encoder", info_.position_resolution));
    expect(std::isfinite(info_.max_force) && info_.max_force > 0, "max_force is not above 0");
    expect(!(info_.max_force > kStrongest), fmt::format("max_force is {:.3g} N; no haptic device has more than {} N. "
                                                        "Every limit of a session depends on this value",
                                                        info_.max_force, kStrongest));
    expect(info_.max_torque >= 0 && info_.max_torque <= kStrongestTurn,
           fmt::format("max_torque is {:.3g} N m; it must be between 0 and {}", info_.max_torque, kStrongestTurn));
    expect(info_.max_continuous_force >= 0 && info_.max_continuous_force <= info_.max_force,
           "max_continuous_force is not between 0 and max_force");
    expect(std::isfinite(info_.nominal_rate) && info_.nominal_rate > 0, "nominal_rate is not above 0");
    expect(!(info_.nominal_rate > kFastestRate),
           fmt::format("nominal_rate is {:.3g} Hz; it must be at most {:g} Hz", info_.nominal_rate, kFastestRate));
    expect(info_.force_axes[0] || info_.force_axes[1] || info_.force_axes[2], "no axis can produce a force");
    judge("description", wrong.empty(),
          wrong.empty() ? fmt::format("{}, {:.3g} N, {:.4g} Hz", info_.model, info_.max_force, info_.nominal_rate)
                        : fmt::format("{}", fmt::join(wrong, "; ")));
  }

  void watch_at_rest() {
    std::string request =
        fmt::format("no force for {:.3g} s: hold the handle still, near the middle of its workspace", options_.rest);
    DeviceState first;
    if (device_->exchange({}, 0, first) == Device::Status::ok && !first.ready)
      request = fmt::format("the device is not ready yet; it must become ready within {:.3g} s. Then {}",
                            options_.ready_timeout, request);
    for (const std::string& note : info_.notes) request += "\n  " + note;
    if (is_real()) user_.does(request);

    RestController rest(options_.rest);
    const bool whole = session(rest, options_.rest, false);
    const bool ready = last_.cause != StopCause::device_not_ready;
    const auto& rows = rest_rows_ = device_->rows();
    if (whole || !rows.empty())
      judge("ready", ready,
            ready ? "it allows forces" : "it stopped allowing forces although no force was sent: " + last_.detail);
    else if (!ready)
      judge("ready", false, last_.detail);
    if (!ready && over_.empty()) over_ = "it is not ready for forces";
    if (rows.size() < 3) return;

    measure_what_it_says(rows);
    if (!whole) return;
    const double span = rows.back().time - rows.front().time;
    if (is_real()) {
      std::size_t fresh = 0;
      for (std::size_t k = 1; k < rows.size(); ++k)
        if (is_new(rows[k - 1], rows[k])) ++fresh;
      const double rate = static_cast<double>(fresh) / span, expected = std::min(options_.rate_hz, info_.nominal_rate),
                   share = options_.busy_machine ? kNewStatesBusy : kNewStates;
      judge("rate", rate >= share * expected,
            fmt::format("{:.0f} of {:.0f} new states per second; {:.2g} % of the exchanges returned no new state", rate,
                        expected, 100 * (1 - static_cast<double>(fresh) / static_cast<double>(rows.size() - 1))),
            {{"rate", rate, "Hz"}});
    } else {
      leave_out("rate", "its virtual time advances only with the exchanges");
    }
    const double noise = noise_of(rows),
                 limit = info_.position_resolution > 0 ? kLoudCounts * info_.position_resolution : kLoud;
    noise_ = noise;
    judge("noise", noise <= limit,
          fmt::format("{} rms per axis; the limit is {}", distance_text(noise), distance_text(limit)),
          {{"noise", noise, "m"}});
    // Only the last 0.2 s: earlier motion may come from a hand that settles.
    const auto late = std::find_if(rows.begin(), rows.end(),
                                   [&](const Exchanged& row) { return row.time >= rows.back().time - 0.2; });
    creep_ = (rows.back().state.position - late->state.position).norm() / std::max(rows.back().time - late->time, 1e-3);
  }

  /// Returns true if two exchanges brought different samples, by their numbers or else by the times of the samples.
  static bool is_new(const Exchanged& before, const Exchanged& now) {
    if (now.state.sequence != 0) return now.state.sequence != before.state.sequence;
    return now.state.age == 0 || now.taken_ns - before.taken_ns > kOneState;
  }

  void measure_what_it_says(const std::vector<Exchanged>& rows) {
    const auto all = [&rows](bool says, const auto& measured) {
      return std::all_of(rows.begin(), rows.end(), [&](const Exchanged& row) { return measured(row.state) == says; });
    };
    std::vector<std::string> wrong;
    const auto expect = [&](const char* what, bool says, const auto& measured) {
      if (!all(says, measured))
        wrong.push_back(fmt::format("it states that it {} {}, but its answers contradict this",
                                    says ? "measures" : "does not measure", what));
    };
    expect("velocity", info_.measures_velocity, [](const DeviceState& s) { return is_finite(s.velocity); });
    expect("orientation", info_.measures_orientation,
           [](const DeviceState& s) { return s.orientation.coeffs().allFinite(); });
    expect("force", info_.measures_force, [](const DeviceState& s) { return is_finite(s.force); });
    judge("measures", wrong.empty(),
          wrong.empty()
              ? fmt::format("position{}{}{}", info_.measures_velocity ? ", velocity" : "",
                            info_.measures_orientation ? ", orientation" : "", info_.measures_force ? ", force" : "")
              : fmt::format("{}", fmt::join(wrong, "; ")));
  }

  [[nodiscard]] std::string why_no_forces() {
    if (!over_.empty()) return over_;
    if (!options_.no_forces.empty()) return options_.no_forces;
    if (creep_ > kCreeps)
      return fmt::format("it moves by itself at {}/s, which hides the effect of a small force; hold it still",
                         distance_text(creep_));
    if (is_inside()) return "";
    if (is_real() && user_.does("no force: move the handle into the middle of its workspace, and hold it there")) {
      RestController rest(0.1);
      if (!session(rest, 0.1, false)) return over_.empty() ? last_.detail : over_;
    }
    return is_inside() ? "" : kOutside;
  }

  [[nodiscard]] bool is_inside() const {
    if (device_->rows().empty()) return false;
    const Vec3 margin = (0.25 * (info_.workspace_max - info_.workspace_min)).cwiseMin(kMargin),
               position = device_->rows().back().state.position;
    return (position.array() >= (info_.workspace_min + margin).array()).all() &&
           (position.array() <= (info_.workspace_max - margin).array()).all();
  }

  void try_forces() {
    no_more_forces_ = why_no_forces();
    for (int axis = 0; axis < 3; ++axis) push(axis);
    judge_gentleness();
    judge_latency();
    const std::string tried =
        most_sent_ > 0 ? fmt::format("the test sent at most {:.3g} N", most_sent_) : "the test sent no force";
    leave_out("stated_force", fmt::format("it states {:.3g} N; {}", info_.max_force, tried));
    send_no_number();
    pause_while_it_pushes();
    feel();
  }

  /// Asks the user to allow a force. If the force is not sent, `why` holds the reason.
  bool may_send(const std::string& what, std::string& why) {
    why = !over_.empty() ? over_ : no_more_forces_;
    if (why.empty() && stop_.count() > 0) {
      report_.interrupted = true;
      why = over_ = "the test was stopped earlier";
    }
    if (why.empty() && !user_.allows(what))
      why = stop_.count() > 0 ? "the test was stopped earlier" : "the user did not allow its force";
    return why.empty();
  }

  /// Runs a session with force. If it ends early, `why` holds the reason.
  bool force_session(Controller& controller, double seconds, std::string& why) {
    const bool whole = session(controller, seconds, true);
    most_sent_ = std::max(most_sent_, last_.max_force);
    if (!whole) why = over_.empty() ? last_.detail : over_;
    if (last_.cause == StopCause::velocity) send_no_more(last_.detail);
    return whole;
  }

  /// Checks again that the handle is inside, because it may have moved while the user was asked.
  bool is_still_inside(std::string& why) {
    constexpr double kLook = 0.05;  // [s]
    RestController rest(kLook);
    if (!session(rest, kLook, false))
      why = over_.empty() ? last_.detail : over_;
    else if (!is_inside())
      why = kOutside;
    return why.empty();
  }

  bool probe(ProbeController& controller, double seconds, std::string& why) {
    if (is_real() && !is_still_inside(why)) return false;
    const bool whole = force_session(controller, seconds, why);
    farthest_ = std::max(farthest_, controller.farthest());
    if (!controller.went_too_far()) return whole;
    why = fmt::format("the handle moved by {}, or left its workspace, under at most {:.2g} N",
                      distance_text(controller.farthest()), last_.max_force);
    send_no_more(why);
    return false;
  }

  void send_no_more(const std::string& why) {
    too_fast_ = why;
    no_more_forces_ = why + "; no force was sent after that";
  }

  void push(int axis) {
    const char* const id = kAxisLaws[axis];
    const char name = "xyz"[axis];
    if (!info_.force_axes[static_cast<std::size_t>(axis)]) return leave_out(id, "this axis has no motor");
    std::string why;
    const std::string announcement = fmt::format(
        "a force along {}, forwards and then backwards. It grows to at most {:.3g} N and reverses once the handle has "
        "moved by {:.0f} mm{}",
        name, options_.max_force, 1e3 * PushController::kReach,
        is_real() ? ". Hold the handle loosely, and let it move" : "");
    if (!may_send(announcement, why)) return leave_out(id, why);

    FirstPush push{axis, options_.max_force, std::max({5e-5, 2 * info_.position_resolution, 5 * noise_}), {}};
    PushController controller = push.controller(info_);
    if (!probe(controller, controller.duration(), why)) return leave_out(id, why);
    if (!first_push_) {
      first_push_ = push;
      first_push_->rows = device_->rows();
    }
    judge_push(axis, controller);
  }

  void judge_push(int axis, const PushController& controller) {
    const char* const id = kAxisLaws[axis];
    const auto& strokes = controller.strokes();
    Push push{.response = response(strokes)};
    const double size = push.response.norm();
    if (size < kLeastResponse)
      return leave_out(
          id,
          fmt::format("{:.3g} N moved it by {}: friction hides the direction. Allow a larger force with --max-force",
                      options_.max_force, distance_text(size)));
    if ((strokes[0].path + strokes[1].path).norm() > 2 * kOwnMotion * size)
      return leave_out(id, "its motion hardly depended on the force: hold it still, but more loosely");

    const double cosine = push.response[axis] / size;
    push.aligned = cosine >= kAligned;
    if (strokes[0].reached && strokes[1].reached) {
      push.moving_force = controller.growth() * (strokes[0].moves - strokes[0].begin);
      for (const Stroke& stroke : strokes) {
        const double moving = stroke.turned - stroke.moves;
        const double mass = controller.growth() * moving * moving * moving / (6 * stroke.path.norm());
        push.mass = std::fmax(push.mass, mass);
        push.reaching_force = std::fmin(push.reaching_force, controller.growth() * (stroke.turned - stroke.begin));
        push.least_mass = std::fmin(push.least_mass, mass);
      }
      lightest_ = std::min(lightest_, push.mass);
    }
    const double angle = std::acos(std::clamp(cosine, -1.0, 1.0));
    for (std::size_t k = 0; k < strokes.size() && push.aligned; ++k)
      if (const double delay = latency_of(device_->rows(), strokes[k], axis, info_.virtual_time); std::isfinite(delay))
        delays_.push_back(delay);
    std::string detail = fmt::format("it moved at {:.0f} degrees to the force, by {:.2g}, {:.2g}, {:.2g} mm",
                                     angle * 180 / std::numbers::pi, 1e3 * push.response.x(), 1e3 * push.response.y(),
                                     1e3 * push.response.z());
    if (!push.aligned)
      detail += cosine < -kAligned ? ": the motor or the encoder of this axis has the wrong sign"
                                   : ": axes are swapped or rotated between its motors and its encoders";
    judge(id, push.aligned, detail,
          {{"angle", angle, "rad"}, {"motion", size, "m"}, {"moving_force", push.moving_force, "N"}});
    pushes_[static_cast<std::size_t>(axis)] = push;
  }

  void judge_gentleness() {
    if (!too_fast_.empty())
      judge("gentle", false, too_fast_ + ". Its forces are larger than commanded, or something else pushes it");
    else if (lightest_ < kLightest)
      judge("gentle", false,
            fmt::format("its apparent mass was {:.2g} g: its forces are larger than commanded", 1e3 * lightest_),
            {{"mass", lightest_, "kg"}});
    else if (most_sent_ > 0)
      judge("gentle", true,
            fmt::format("it moved by at most {} under at most {:.2g} N", distance_text(farthest_), most_sent_),
            {{"distance", farthest_, "m"}, {"force", most_sent_, "N"}});
    else
      leave_out("gentle", over_.empty() ? no_more_forces_.empty() ? "no force was sent" : no_more_forces_ : over_);
  }

  void judge_latency() {
    if (delays_.empty()) return leave_out("latency", "no force moved it far enough for this test");
    const double typical = median(delays_);
    judge("latency", typical <= kSoon,
          fmt::format("{:.1f} ms, within 2 ms, from sending a force to measuring its motion; median of {}",
                      1e3 * typical, delays_.size()),
          {{"latency", typical, "s"}});
  }

  /// Lets the user feel a spring, if no axis pushes the wrong way.
  void feel() {
    if (!is_real()) return leave_out("opposes", "no user can feel a force in virtual time");
    if (!user_.is_there()) return leave_out("opposes", "no user is at the device to feel it");
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (info_.force_axes[axis] && !(pushes_[axis] && pushes_[axis]->aligned))
        return leave_out("opposes", "this test needs every axis to move along its force first");
    std::string why;
    if (!may_send(
            fmt::format("a soft spring of at most {:.3g} N that holds the handle at its present position, for {:.0f} "
                        "s. Move the handle back and forth by a few millimetres, and feel whether it pulls back",
                        options_.max_force, options_.feel),
            why))
      return leave_out("opposes", why);
    SpringController spring(info_, options_.max_force, options_.feel);
    if (!force_session(spring, options_.feel, why)) return leave_out("opposes", why);
    const auto felt = user_.answers("did the handle pull back to its first position?");
    if (!felt) return leave_out("opposes", "the user gave no answer");
    judge("opposes", *felt, *felt ? "the user felt the spring" : "the user felt no spring");
  }

  void send_no_number() {
    std::string why;
    if (!may_send(fmt::format("for {:.0f} ms, a force that is not finite; the handle must not move",
                              1e3 * RestController::kSpoilt),
                  why))
      return leave_out("nan_force", why);
    constexpr double kBefore = 0.1;  // [s]
    RestController controller(3 * kBefore, kBefore, *device_);
    if (!force_session(controller, 3 * kBefore, why)) {
      if (last_.cause == StopCause::velocity || last_.cause == StopCause::not_finite)
        return judge("nan_force", false, last_.detail);
      return leave_out("nan_force", why);
    }
    const auto& rows = device_->rows();
    const Vec3 first = rows.front().state.position;
    Vec3 spoilt = first;
    double after = 0, before = 0;
    for (const Exchanged& row : rows) {
      if (row.time < kBefore) {
        spoilt = row.state.position;
        before = std::max(before, (row.state.position - first).norm());
      } else {
        after = std::max(after, (row.state.position - spoilt).norm());
      }
    }
    const double allowed = kUnmoved + 3 * before;
    judge("nan_force", after <= allowed,
          fmt::format("it moved by {}; the limit is {}", distance_text(after), distance_text(allowed)),
          {{"motion", after, "m"}});
  }

  void pause_while_it_pushes() {
    if (!is_real()) return leave_out("host_pause", "its virtual time stops while the host pauses");
    const auto easiest = easiest_push();
    if (!easiest)
      return leave_out("host_pause", no_more_forces_.empty() && over_.empty()
                                         ? "no force moved it far enough for this test"
                                     : over_.empty() ? no_more_forces_
                                                     : over_);
    const auto [axis, force] = *easiest;
    std::string why;
    if (!may_send(fmt::format("{:.2g} N along {} for {:.0f} ms, then larger forces until the handle moves by {:.0f} "
                              "mm, at most {:.3g} N. Then the same force again while the host pauses: the device must "
                              "remove it by itself. Hold the handle loosely",
                              force, "xyz"[axis], 1e3 * HoldController::kLongest, 1e3 * kHeldPath, options_.max_force),
                  why))
      return leave_out("host_pause", why);
    auto before = hold_until_it_moves(axis, force);
    for (int round = 0; before; ++round) {
      const auto paused = hold(axis, before->force, before->seconds, HoldController::Host::pauses);
      if (!paused) return;
      const auto after = hold(axis, before->force, before->seconds, HoldController::Host::goes_on);
      if (!after) return;
      const double share = paused->way() / before->way();
      const bool kept = share <= kLetGo, alike = after->way() > 0.5 * before->way();
      if (alike && kept == (paused->way() <= kLetGo * after->way()))
        return judge("host_pause", kept,
                     fmt::format("it moved {:.0f} % of the distance that it moves under a force that continues{}",
                                 100 * std::max(share, 0.0), kept ? "" : kNoWatchdog),
                     {{"share", share, "1"}});
      // A hand moves by itself and does not always hold equally tight. A larger force outweighs both.
      if (round == kLouder || before->force >= options_.max_force || before->seconds < HoldController::kLongest)
        return leave_out("host_pause",
                         "the same force moved it by a different distance each time: hold it still, but more loosely");
      before = hold(axis, std::min(kLouderBy * before->force, options_.max_force), HoldController::kLongest,
                    HoldController::Host::goes_on);
    }
  }

  /// Returns the axis on which the handle moved most easily, and a force that moves it slowly, if at all [N].
  [[nodiscard]] std::optional<std::pair<int, double>> easiest_push() const {
    constexpr double kTime = HoldController::kLongest;
    std::optional<std::pair<int, double>> easiest;
    for (int axis = 0; axis < 3; ++axis) {
      const auto& push = pushes_[static_cast<std::size_t>(axis)];
      if (!push || !push->aligned || !std::isfinite(push->reaching_force)) continue;
      // The smaller of two forces: one for a mass alone, one for friction and dampers alone.
      const double force =
          std::min(push->least_mass * 2 * HoldController::kFar / (kTime * kTime), 0.5 * push->reaching_force);
      if (!easiest || force < easiest->second) easiest = {axis, force};
    }
    if (easiest) easiest->second = std::clamp(easiest->second, kLeastHeld * options_.max_force, options_.max_force);
    return easiest;
  }

  struct Hold {
    double force, seconds, path;  ///< [N, s, m]
    /// Returns the path over the square of its time [m/s^2], to compare times that differ a little.
    [[nodiscard]] double way() const { return path / (seconds * seconds); }
  };

  /// Increases the force until the handle moves. If it never moves far enough, or if a session ends early, reports that
  /// and returns nothing.
  std::optional<Hold> hold_until_it_moves(int axis, double force) {
    const double enough = std::max(kHeldPath, 5 * info_.position_resolution);
    for (;;) {
      const auto held = hold(axis, force, HoldController::kLongest, HoldController::Host::goes_on);
      if (!held) return std::nullopt;
      const double path = held->path;
      if (path >= enough && held->seconds >= kShortestHold) return held;
      if (path >= enough || force >= options_.max_force) {
        leave_out(
            "host_pause",
            path >= enough
                ? fmt::format("{:.2g} N moved it too fast, and a slightly smaller force did not move it", force)
                : fmt::format("{:.2g} N moved it by {}, which is too little. Allow a larger force with --max-force",
                              force, distance_text(std::max(path, 0.0))));
        return std::nullopt;
      }
      force = std::min(kHarder * force, options_.max_force);
    }
  }

  /// Returns nothing if the session ended early, and reports that.
  std::optional<Hold> hold(int axis, double force, double seconds, HoldController::Host host) {
    const bool pauses = host == HoldController::Host::pauses;
    HoldController controller(info_, force * Vec3::Unit(axis), seconds, host);
    std::string why;
    const bool whole = probe(controller, 1, why);
    if (whole) return Hold{force, controller.held(), controller.path()};
    if (pauses && last_.cause == StopCause::device_lost) {
      lost_ = false;
      over_ = "it ended the connection when the host paused";
      judge("host_pause", true, "it ended the connection, which is safe: " + last_.detail);
    } else if (pauses && last_.cause == StopCause::device_not_ready) {
      judge("host_pause", true, "it stopped allowing forces, which is safe");
    } else if (pauses && (last_.cause == StopCause::velocity || controller.went_too_far())) {
      judge("host_pause", false, why + kNoWatchdog);
    } else {
      leave_out("host_pause", why);
    }
    return std::nullopt;
  }

  /// Judges the laws that concern all sessions.
  void judge_whole() {
    if (const DurationHistogram& time = device_->exchange_time(); time.count() > 0) {
      const double tick = 1 / options_.rate_hz, late = options_.busy_machine ? kLateBusy : kLate;
      judge("exchange", time.quantile(1 - late) <= tick,
            fmt::format("p50 {}, p99 {}, max {}; a tick lasts {}", duration_text(time.quantile(0.5)),
                        duration_text(time.quantile(0.99)), duration_text(time.max()), duration_text(tick)),
            {{"p50", time.quantile(0.5), "s"}, {"p99", time.quantile(0.99), "s"}, {"max", time.max(), "s"}});
    }
    if (ages_.count() > 0) {
      const double median = ages_.quantile(0.5), most = options_.busy_machine ? kStaleBusy : kStale;
      judge("fresh", !wrong_age_ && median <= most,
            wrong_age_ ? "an age is negative or not finite"
                       : fmt::format("age p50 {}, p99 {}; the limit of p50 is {}", duration_text(median),
                                     duration_text(ages_.quantile(0.99)), duration_text(most)),
            {{"p50", median, "s"}, {"p99", ages_.quantile(0.99), "s"}});
      judge("finite", !not_finite_,
            not_finite_ ? "a position was not finite" : fmt::format("{} positions", ages_.count()));
    }
    judge("stays", !lost_, lost_ ? last_.detail : "it answered every exchange");
    judge_whether_it_follows();
    judge_resolution();
  }

  /// A position that never changes means that nothing moved the handle, or that the encoders do not count. Only a hand
  /// that moves the handle, or a force above any friction, can tell the two apart.
  void judge_whether_it_follows() {
    if (moved_) return judge("follows", true, "its position changed");
    if (!first_position_) return leave_out("follows", over_.empty() ? "the test collected no data" : over_);
    constexpr const char* kFrozen =
        "its position stayed the same, to the last digit, {}. Check that its encoders are connected and that each "
        "state is a new one";
    const std::string pushed = fmt::format("under forces of up to {:.3g} N", most_sent_);
    if (most_sent_ >= kStiction) return judge("follows", false, fmt::format(kFrozen, pushed));
    const bool asked =
        over_.empty() && is_real() && user_.does("no force: move the handle by some centimetres, and leave it there");
    constexpr double kLook = 0.1;  // [s]
    RestController rest(kLook);
    if (asked && session(rest, kLook, false))
      return judge("follows", moved_, moved_ ? "its position changed" : fmt::format(kFrozen, "although it was moved"));
    leave_out("follows",
              fmt::format("its position never changed{}: friction or a firm hand holds the handle, or the encoders do "
                          "not count. Run the test at a terminal, and move the handle when the test asks you to",
                          most_sent_ > 0 ? " " + pushed : ""));
  }

  void judge_resolution() {
    const double step = steps_.distance, stated = info_.position_resolution;
    const std::vector<LawFinding::Figure> figures{{"smallest_step", step, "m"}, {"stated", stated, "m"}};
    if (steps_.steps < kLeastSteps) return tell("resolution", Verdict::not_tested, "it hardly moved", figures);
    const std::string seen = fmt::format("the smallest of {} steps was {}", steps_.steps, distance_text(step));
    if (stated <= 0) return tell("resolution", Verdict::not_tested, "it states no resolution; " + seen, figures);
    judge("resolution", step <= kCoarser * stated && stated <= kFiner * step,
          fmt::format("{}; it states {}", seen, distance_text(stated)), figures);
  }

  void close_and_reopen() {
    DeviceState state;
    (void)device_->exchange({}, 0, state);
    report_.zero_force = device_->zero_force();
    device_->close();
    const bool lost = device_->exchange({}, 1e-3, state) == Device::Status::lost;
    device_->close();
    const bool still = device_->exchange({}, 1e-3, state) == Device::Status::lost;
    judge("closes", lost && still,
          !lost || !still ? "it still answers after close" : "also after a second close: " + device_->lost_reason());

    if (lost_ || report_.interrupted) return leave_out("reopens", over_);
    try {
      device_ = std::make_unique<ObservedDevice>(open_());
      const DeviceInfo& info = device_->info();
      const bool same = info.backend == info_.backend && info.model == info_.model && info.serial == info_.serial;
      const bool answers = device_->exchange({}, 0, state) == Device::Status::ok;
      judge("reopens", same && answers,
            !same     ? fmt::format("another device answers: {} {}", info.model, info.serial)
            : answers ? "the same device answers"
                      : device_->lost_reason());
      if (same && answers && !is_real()) repeat();
    } catch (const Error& error) {
      judge("reopens", false, error.what());
    }
    device_->close();
    report_.zero_force = std::max(report_.zero_force, device_->zero_force());
  }

  /// Repeats everything that the first device received, up to its first push.
  void repeat() {
    if (!over_.empty()) return;
    const auto equal = [this](const std::vector<Exchanged>& before) {
      const auto& rows = device_->rows();
      return std::equal(before.begin(), before.end(), rows.begin(), rows.end(),
                        [](const auto& a, const auto& b) { return a.state.position == b.state.position; });
    };
    RestController rest(options_.rest);
    if (!session(rest, options_.rest, false)) return;
    std::size_t exchanges = device_->rows().size();
    bool same = equal(rest_rows_);
    std::string why;
    if (same && first_push_ && may_send("the first of these forces again; the response must be the same", why)) {
      PushController controller = first_push_->controller(info_);
      if (!probe(controller, controller.duration(), why)) return;
      same = equal(first_push_->rows);
      exchanges += device_->rows().size();
    }
    judge("repeats", same,
          same ? fmt::format("{} answers were identical to the last digit", exchanges)
               : "after it was opened again, it answered the same commands differently");
  }

  ConformanceReport conclude() {
    for (const Law& law : kLaws) {
      if (is_told(law.id)) continue;
      const bool other_clock = std::string_view(law.id) == "repeats" && is_real();
      leave_out(law.id, other_clock     ? "the device runs in real time"
                        : over_.empty() ? "the test collected no data"
                                        : over_);
    }
    const auto place = [](const LawFinding& finding) {
      return std::find_if(std::begin(kLaws), std::end(kLaws), [&](const Law& law) { return finding.id == law.id; });
    };
    std::sort(report_.findings.begin(), report_.findings.end(),
              [&](const LawFinding& a, const LawFinding& b) { return place(a) < place(b); });
    return std::move(report_);
  }

  const std::function<std::unique_ptr<Device>()>& open_;
  ConformanceOptions options_;
  ConformanceUser& user_;
  const StopRequest& stop_;
  std::unique_ptr<ObservedDevice> device_;
  const DeviceInfo info_;
  ConformanceReport report_;
  ServoReport last_;

  std::string over_;            ///< why all further tests are skipped
  std::string no_more_forces_;  ///< why all further forces are skipped
  std::string too_fast_;        ///< how a force moved the handle too fast or too far
  std::optional<Vec3> first_position_;
  bool moved_ = false;  ///< a position differed from the first one
  bool lost_ = false, not_finite_ = false, wrong_age_ = false;
  DurationHistogram ages_;
  SmallestStep steps_;
  double noise_ = 0;                                           ///< at rest [m]
  double creep_ = 0;                                           ///< at rest [m/s]
  double most_sent_ = 0, farthest_ = 0;                        ///< [N], [m]
  double lightest_ = std::numeric_limits<double>::infinity();  ///< least apparent mass in a push [kg]
  std::vector<Exchanged> rest_rows_;
  std::optional<FirstPush> first_push_;
  std::array<std::optional<Push>, 3> pushes_;  ///< those that show a direction
  std::vector<double> delays_;                 ///< [s]
};

}  // namespace

const char* to_string(LawFinding::Verdict verdict) noexcept {
  switch (verdict) {
    case LawFinding::Verdict::passed:
      return "passed";
    case LawFinding::Verdict::failed:
      return "failed";
    case LawFinding::Verdict::not_tested:
      return "not_tested";
  }
  return "unknown";
}

int ConformanceReport::count(LawFinding::Verdict verdict) const noexcept {
  return static_cast<int>(
      std::count_if(findings.begin(), findings.end(), [&](const LawFinding& f) { return f.verdict == verdict; }));
}

ConformanceReport test_conformance(const std::function<std::unique_ptr<Device>()>& open,
                                   const ConformanceOptions& options, ConformanceUser& user, const StopRequest& stop) {
  check_range("the rate", options.rate_hz, kLowestRate, kHighestRate, "Hz");
  check_range("--max-force", options.max_force, 1e-3, 100, "N");
  check_range("the largest velocity", options.max_velocity, 1e-3, 10, "m/s");
  check_range("the time at rest", options.rest, 0.1, 3600, "s");
  check_range("the duration of the spring", options.feel, 0.1, 60, "s");
  return Examination(open, options, user, stop).run();
}

}  // namespace haptrace
