// Detection rate, misses and false alarms of ForceGuard, with random plants, hands and laws on one axis.
//   haptrace_vibration [DRAWS] [HOURS] [SEED]        default 4000 draws, 2 hours, seed 1; 0 skips that part
//   VERBOSE=1: print every case that was missed or did not become calm, and every false alarm, with its setting
//
// Ground truth: all inputs (hand, tremor, path) are frozen. An oscillation is real if, 1.3 s later, it persists with
// more than half of its ripple. A case is an oscillation that persists with more than F/4 rms. Its onset is when the
// ripple, averaged over 50 ms, passes F/4. See docs/monitor.md.
#include "control/filters.h"
#include "control/force_guard.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <random>
#include <vector>

using namespace haptrace;

namespace {

using std::numbers::pi;

enum class Law { pd, wall };
enum class Activity { rest, tremor, writing, tapping, knocks, pushing, letting_go, steps, count };

struct Draw {
  explicit Draw(std::uint64_t seed) : random(seed) {}
  double operator()(double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); }
  double log(double from, double to) { return from * std::pow(to / from, (*this)(0, 1)); }
  std::mt19937_64 random;
};

/// Parameters of one plant, one hand and one law.
struct Setting {
  double rate = 1000, force = 8;                                // [Hz], [N]
  double mass = 0.3, viscous = 1, coulomb = 0.2, count = 3e-5;  // [kg], [N s/m], [N], [m]
  double delay = 1e-3, lag = 5e-4;                              // [s]
  double velocity_hz = 100;                                     // cut-off of the velocity's low-pass filter
  double resonance = 0;                                         // [Hz]; 0: none
  double hand_mass = 0, grip = 0, grip_damping = 0;             // [kg], [N/m], [N s/m]
  Law law = Law::pd;
  double kp = 500, kd = 6;
  Activity activity = Activity::rest;
  double tremor = 0, tremor_hz = 8;     // [N], [Hz]
  double texture = 0, texture_hz = 80;  // [N], declared

  /// Returns the delay from position to force [s].
  [[nodiscard]] double late() const { return 0.5 / rate + delay + lag + 0.23 / velocity_hz; }

  /// Returns whether a knock makes the loop ring; a calibration does not choose such gains. Stiffness with delay acts
  /// as negative damping. The loop rings if the remaining damping, without Coulomb friction, is below a tenth of
  /// critical, or if one encoder count changes the force by more than about F/4.
  [[nodiscard]] bool rings() const {
    const double moved = mass + hand_mass, damping = kd + viscous + grip_damping - kp * late();
    return damping < 0.1 * 2 * std::sqrt(kp * moved) || kd * count * 2 * pi * velocity_hz > 0.25 * force;
  }

  void print(const char* what) const {
    std::printf(
        "    %s: rate %.0f, F %.1f, mass %.2f, viscous %.1f, coulomb %.2f, count %.0f um, delay %.1f ms, lag %.1f ms, "
        "velocity %.0f Hz, resonance %.0f Hz, hand %.2f kg %.0f N/m, %s kp %.0f kd %.1f, activity %d, tremor %.2f N "
        "%.0f Hz, texture %.2f N %.0f Hz\n",
        what, rate, force, mass, viscous, coulomb, 1e6 * count, 1e3 * delay, 1e3 * lag, velocity_hz, resonance,
        hand_mass, grip, law == Law::pd ? "pd" : "wall", kp, kd, static_cast<int>(activity), tremor, tremor_hz, texture,
        texture_hz);
  }
};

bool verbose() {
  static const bool asked = std::getenv("VERBOSE") != nullptr;
  return asked;
}

Setting draw_setting(Draw& draw, double least_factor, double most_factor, double most_tremor, bool any_rate) {
  Setting s;
  constexpr std::array kRates{250.0, 500.0, 1000.0, 2000.0, 4000.0, 10000.0};
  if (any_rate) s.rate = kRates[static_cast<std::size_t>(draw(0, 5.999))];
  s.force = draw(3, 12);
  s.mass = draw.log(0.05, 2);
  s.viscous = draw.log(0.2, 4);
  s.coulomb = draw.log(0.03, std::min(1.2, 0.3 * s.force));
  s.count = draw.log(1e-5, 1e-4);
  s.delay = draw(0, 6e-3);
  s.lag = draw.log(1e-4, 2e-3);
  if (draw(0, 1) < 0.2) s.resonance = draw.log(15, 200);
  if (draw(0, 1) > 0.1) {
    const double firm = draw(0, 1);
    s.hand_mass = 0.03 + 0.25 * firm;
    s.grip = 20 * std::pow(60, firm);
    s.grip_damping = 0.5 + 10 * firm;
  }
  if (draw(0, 1) < 0.25) {  // a fast device: its loop is unstable at high frequencies
    s.velocity_hz = std::min(500.0, 0.3 * s.rate);
    s.delay *= 0.1;
    s.lag = std::min(s.lag, 3e-4);
  }
  const double late = s.late(), moved = s.mass + s.hand_mass;
  s.law = draw(0, 1) < 0.6 ? Law::pd : Law::wall;
  s.kd = draw.log(least_factor, most_factor) * 0.5 * moved / late;
  s.kp = draw.log(least_factor, most_factor) * 0.2 * moved / (late * late);
  if (s.law == Law::wall) {
    s.kp = std::clamp(s.kp, 200.0, 20e3);
    s.kd = draw(0, 1) < 0.5 ? 0 : 0.1 * s.kd;
  }
  s.activity = static_cast<Activity>(static_cast<int>(draw(0, static_cast<double>(Activity::count) - 1e-9)));
  s.tremor = draw(0.05, most_tremor);
  s.tremor_hz = draw(4, 12);
  return s;
}

/// The simulated loop: device, hand, law and guard. A copy continues from the same state.
class World {
 public:
  World(const Setting& s, bool softens)
      : s_(s),
        substeps_(std::max(4, static_cast<int>(8000 / s.rate))),
        step_(1 / (s.rate * substeps_)),
        delayed_(static_cast<std::size_t>(s.delay / step_) + 2, 0.0),
        velocity_(Butterworth2::Kind::low_pass, s.velocity_hz, s.rate),
        high_(Butterworth2::Kind::high_pass, 5, s.rate),
        guard_({.monitor = {.rate_hz = s.rate, .max_force = s.force, .position_resolution = s.count}}),
        softens_(softens) {
    if (s.law == Law::wall) x_ = 0.01;
  }

  void tick(bool frozen) {
    if (!frozen) time_ += 1 / s_.rate;
    ++ticks_;
    const double measured = s_.count * std::round(x_ / s_.count);
    const double v = velocity_.update((measured - last_) * s_.rate);
    last_ = measured;
    double asked = 0;
    if (s_.law == Law::pd) asked = s_.kp * (reference() - measured) - s_.kd * v;
    if (s_.law == Law::wall && measured < 0) asked = std::max(0.0, -s_.kp * measured - s_.kd * v);
    asked += s_.texture * std::sin(2 * pi * s_.texture_hz * time_);
    if (softens_) asked = guard_.soften({.force = Vec3(asked, 0, 0), .torque = Vec3::Zero()}, Vec3::Zero()).force.x();
    if (ended_at_ < ticks_) asked *= std::max(0.0, 1 - static_cast<double>(ticks_ - ended_at_) / (0.05 * s_.rate));
    force_ = std::clamp(asked, -s_.force, s_.force);
    event_ = guard_.watch({.force = Vec3(force_, 0, 0), .torque = Vec3::Zero()}, Vec3(measured, 0, 0), s_.texture,
                          1 / s_.rate);
    if (softens_ && guard_.beyond_help()) ended_at_ = std::min(ended_at_, ticks_);
    const double before = band_;
    band_ = high_.update(force_);
    energy_ += -std::expm1(-1 / (0.05 * s_.rate)) * (band_ * band_ - energy_);
    crossings_ += (band_ > 0) != (before > 0);
    for (int i = 0; i < substeps_; ++i) move();
  }

  [[nodiscard]] double ripple() const { return std::sqrt(energy_); }  // above 5 Hz [N rms]
  [[nodiscard]] double band() const { return band_; }                 // the force above 5 Hz [N]
  [[nodiscard]] const std::optional<Event>& event() const { return event_; }
  [[nodiscard]] bool ended() const { return ended_at_ <= ticks_; }
  [[nodiscard]] double share() { return guard_.summary().share; }
  [[nodiscard]] long crossings() const { return crossings_; }
  [[nodiscard]] double time() const { return static_cast<double>(ticks_) / s_.rate; }

 private:
  /// Returns the position of the path [m]. It starts from rest, like the approach of a session.
  [[nodiscard]] double path() const {
    const double u = std::min(1.0, time_);
    return u * u * (3 - 2 * u) * 0.03 * std::sin(2 * pi * 0.3 * time_);
  }

  [[nodiscard]] double reference() const {
    const double along = path();
    return s_.activity == Activity::steps ? along + (std::fmod(time_, 1) < 0.5 ? 0.004 : 0) : along;
  }

  /// Returns the hand's target position [m].
  [[nodiscard]] double aim() const {
    const double base = s_.law == Law::wall ? (time_ > 0.5 ? -0.004 : 0.01) : path();
    switch (s_.activity) {
      case Activity::writing:
        return base + 0.003 * std::sin(2 * pi * 8 * time_);
      case Activity::tapping:
        return base + 0.01 * std::sin(2 * pi * (2 + 4.5 * std::fmod(s_.tremor_hz, 1)) * time_);
      case Activity::pushing:
        return std::fmod(time_, 2) > 1 ? base - 0.01 : base;
      default:
        return base;
    }
  }

  void move() {
    delayed_[at_] = force_;
    at_ = (at_ + 1) % delayed_.size();
    actuated_ += step_ / s_.lag * (delayed_[at_] - actuated_);
    double pushed = actuated_;
    if (s_.resonance > 0) {  // a lightly damped mode with a tenth of the mass, in parallel to the rigid body
      const double w = 2 * pi * s_.resonance;
      mode_v_ += step_ * (actuated_ / (0.3 * s_.mass) * 0.1 - 2 * 0.03 * w * mode_v_ - w * w * mode_);
      mode_ += step_ * mode_v_;
    }
    const bool held = s_.grip > 0 && !(s_.activity == Activity::letting_go && std::fmod(time_, 3) > 1.5);
    if (held) pushed += s_.grip * (aim() - body_) - s_.grip_damping * v_;
    if (s_.grip == 0 && s_.law == Law::wall) pushed -= 1;  // the device's weight
    pushed += s_.tremor * (s_.activity == Activity::tremor && held ? std::sin(2 * pi * s_.tremor_hz * time_) : 0);
    if (s_.activity == Activity::knocks && std::fmod(time_, 1) < 0.01) pushed += 6;
    pushed -= s_.viscous * v_ + s_.coulomb * std::tanh(v_ / 1e-3);
    v_ += step_ * pushed / (s_.mass + (held ? s_.hand_mass : 0));
    body_ += step_ * v_;
    // Ends of the workspace.
    if (std::abs(body_) > 0.1) {
      body_ = std::copysign(0.1, body_);
      v_ = 0;
    }
    x_ = body_ + mode_;
  }

  Setting s_;
  int substeps_;
  double step_;
  std::vector<double> delayed_;
  std::size_t at_ = 0;
  Butterworth2 velocity_, high_;
  ForceGuard guard_;
  bool softens_;
  double time_ = 0;  // time of the inputs [s]
  long ticks_ = 0, ended_at_ = 1L << 40;
  double x_ = 0, body_ = 0, v_ = 0, mode_ = 0, mode_v_ = 0, last_ = 0;
  double force_ = 0, actuated_ = 0, energy_ = 0, band_ = 0;
  long crossings_ = 0;
  std::optional<Event> event_;
};

/// A self-sustained oscillation.
struct Oscillation {
  double frequency = 0;  // [Hz]; 0: no oscillation
  double rms = 0;        // [N]
};

Oscillation standing(World world, const Setting& s) {
  const double ripple = world.ripple();
  const long wait = std::lround(0.8 * s.rate), count = std::lround(0.5 * s.rate);
  for (long i = 0; i < wait; ++i) world.tick(true);
  const long before = world.crossings();
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    world.tick(true);
    sum += world.band() * world.band();
  }
  if (world.ripple() <= 0.5 * ripple) return {};
  return {.frequency = static_cast<double>(world.crossings() - before),  // 2 crossings in 0.5 s are 2 Hz
          .rms = std::sqrt(sum / static_cast<double>(count))};
}

bool is_fast(const Event& event) {
  return is_oscillation(event.code);
}

struct Band {
  double from, to;
  int cases = 0, found = 0, ever = 0, calm = 0;

  void print(bool reacted = true) const {
    if (cases == 0) return;
    std::printf("  %5.0f to %5.0f Hz: %4d cases  %5.1f / %5.1f %%", from, to, cases, 100.0 * found / cases,
                100.0 * ever / cases);
    if (reacted && ever > 0) std::printf("  calm %5.1f %%", 100.0 * calm / ever);
    std::printf("\n");
  }
};

Band* band_of(std::vector<Band>& bands, double x) {
  const auto band = std::find_if(bands.begin(), bands.end(), [x](const Band& b) { return x >= b.from && x < b.to; });
  return band == bands.end() ? nullptr : &*band;
}

struct Detection {
  std::vector<Band> bands{{3, 5}, {5, 15}, {15, 30}, {30, 60}, {60, 120}, {120, 5000}};
  std::vector<Band> rates{{250, 251}, {500, 501}, {1000, 1001}, {2000, 10001}};  // servo rates; cases from 15 Hz
  std::vector<Band> weaker{{3, 5}, {5, 15}, {15, 120}, {120, 5000}};             // F/8 to F/4, passed F/4 once
  std::vector<double> delays;
  int swaying = 0, softened = 0, ended = 0;  // from 5 to 15 Hz: all; softened within 1 s by a hint or an alarm; ended

  void run(const Setting& s) {
    World open(s, false);
    double onset = -1, alarm = -1, weak_onset = -1;
    Oscillation real, weak;
    for (long i = 0; i < std::lround(4 * s.rate); ++i) {
      open.tick(false);
      if (onset < 0 && open.ripple() > s.force / 4 && i % std::lround(0.04 * s.rate) == 0) {
        real = standing(open, s);
        if (real.frequency > 0 && real.rms > s.force / 4)
          onset = open.time();
        else if (real.frequency > 0 && real.rms > s.force / 8 && weak_onset < 0)
          weak = real, weak_onset = open.time();
      }
      if (alarm < 0 && open.event() && is_fast(*open.event())) alarm = open.time();
      if (onset >= 0 && (alarm >= 0 || open.time() > onset + 1.5)) break;
    }
    if (onset < 0 && weak_onset >= 0) {
      if (Band* band = band_of(weaker, weak.frequency); band != nullptr && weak.frequency <= 0.45 * s.rate) {
        ++band->cases;
        if (alarm >= 0) ++band->ever;
        if (alarm >= 0 && alarm <= weak_onset + 0.5) ++band->found;
      }
      return;
    }
    if (onset < 0 || real.frequency > 0.45 * s.rate) return;
    Band* const band = band_of(bands, real.frequency);
    if (band == nullptr) return;
    const bool found = alarm >= 0 && alarm <= onset + 0.5;
    const bool calm = react(s, onset, alarm, real.frequency);
    count(*band, alarm, found, calm);
    if (real.frequency >= 15) count(*band_of(rates, s.rate), alarm, found, calm);
    if (alarm >= 0) delays.push_back(alarm - onset);
    if (verbose() && ((alarm >= 0 && !calm) || !found) && real.frequency >= 15) {
      std::printf("    %s: %.1f Hz, %.2f F, from %.2f s, alarm at %.2f s\n", found ? "not calm" : "missed",
                  real.frequency, real.rms / s.force, onset, alarm);
      s.print("  of");
    }
  }

  static void count(Band& band, double alarm, bool found, bool calm) {
    ++band.cases;
    band.ever += alarm >= 0;
    band.found += found;
    band.calm += alarm >= 0 && calm;
  }

  /// Lets the guard act. Returns whether, 1 s after the first fast alarm, the loop is calm or its session has ended.
  bool react(const Setting& s, double onset, double alarm, double frequency) {
    World world(s, true);
    double first = -1, softer = -1;
    while (!world.ended() && world.time() < (first >= 0 ? first : std::max(alarm, onset)) + 1) {
      world.tick(false);
      if (!world.event()) continue;
      if (softer < 0) softer = world.time();
      if (first < 0 && is_fast(*world.event())) first = world.time();
    }
    if (frequency >= 5 && frequency < 15) {
      ++swaying;
      softened += softer >= 0 && softer <= onset + 1;
      ended += world.ended();
    }
    return world.ended() || world.ripple() < 0.12 * s.force || standing(world, s).frequency == 0;
  }
};

/// Counts the guard's reactions to loops that do not oscillate.
struct Silence {
  double hours = 0;
  int alarms = 0, softened = 0, ends = 0, hints = 0, unstable = 0;
  double hinted = 0;  // [h]

  void run(const Setting& s, double seconds) {
    World open(s, false);
    std::optional<Event> alarm;
    for (long i = 0; i < std::lround(seconds * s.rate) && !alarm; ++i) {
      open.tick(false);
      if (open.event() && is_fast(*open.event())) alarm = open.event();
      const bool looks = open.ripple() > s.force / 8 && i % std::lround(0.5 * s.rate) == 0;
      if ((alarm || looks) && standing(open, s).frequency > 0) {
        ++unstable;
        return;
      }
    }
    hours += seconds / 3600;
    alarms += alarm.has_value();
    if (alarm && verbose()) {
      std::printf("    false alarm at %.2f s: %s\n", open.time(), describe(*alarm).c_str());
      s.print("  of");
    }
    World closed(s, true);
    bool was_softened = false;
    for (long i = 0; i < std::lround(seconds * s.rate) && !closed.ended(); ++i) {
      closed.tick(false);
      if (closed.event() && is_fast(*closed.event())) was_softened = true;
      hints += closed.event() && closed.event()->code == EventCode::sways;
      if (closed.share() < 1 && !was_softened) hinted += 1 / s.rate / 3600;
    }
    softened += was_softened;
    ends += closed.ended();
  }

  void print(const char* what) const {
    if (hours == 0) return;
    std::printf(
        "  %-24s %5.2f h (and %d draws that oscillate): fast alarms %d (%.2f/h, 95%% below %.2f/h), softened %d, ended "
        "%d (95%% below %.2f/h), hints %d, softened by them %.2f %%\n",
        what, hours, unstable, alarms, alarms / hours, bound(alarms) / hours, softened, ends, bound(ends) / hours,
        hints, 100 * hinted / hours);
  }

  /// Returns the one-sided upper 95 % bound of a Poisson mean, by bisection.
  static double bound(int count) {
    double low = count, high = count + 10 + 4 * std::sqrt(count);
    for (int i = 0; i < 60; ++i) {
      const double mean = 0.5 * (low + high);
      double term = std::exp(-mean), sum = term;
      for (int k = 1; k <= count; ++k) sum += term *= mean / k;
      (sum > 0.05 ? low : high) = mean;
    }
    return low;
  }
};

}  // namespace

int main(int argc, char** argv) {
  const int draws = argc > 1 ? std::atoi(argv[1]) : 4000;
  const double hours = argc > 2 ? std::atof(argv[2]) : 2;
  const std::uint64_t seed = argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 1;

  for (const bool any_rate : {false, true}) {
    Draw draw(seed + (any_rate ? 100 : 0));
    Detection detection;
    for (int i = 0; i < draws / (any_rate ? 2 : 1); ++i)
      detection.run(draw_setting(draw, 0.3, 8, i % 2 == 0 ? 0.3 : 1.0, any_rate));
    if (draws == 0) continue;
    std::printf("%s: above F/4, found within 0.5 s / ever, calm or ended within 1 s of the alarm\n",
                any_rate ? "250 Hz to 10 kHz" : "1 kHz");
    for (const Band& b : detection.bands) b.print();
    if (any_rate) {
      std::printf(" by servo rate, from 15 Hz to 0.45 of it:\n");
      for (const Band& b : detection.rates) b.print();
    }
    std::printf(" F/8 to F/4, after the ripple passed F/4 once:\n");
    for (const Band& b : detection.weaker) b.print(false);
    std::printf("  5 to 15 Hz: softened within 1 s %.1f %%, ended %d of %d\n",
                100.0 * detection.softened / std::max(1, detection.swaying), detection.ended, detection.swaying);
    std::sort(detection.delays.begin(), detection.delays.end());
    if (!detection.delays.empty())
      std::printf("  time to the alarm: median %.2f s, 95 %% %.2f s\n", detection.delays[detection.delays.size() / 2],
                  detection.delays[detection.delays.size() * 95 / 100]);
    std::fflush(stdout);
  }

  constexpr double kRun = 10;  // [s]
  struct Set {
    const char* what;
    double tremor, share;
    bool texture, any_rate;
  };
  for (const Set& set : {Set{"tremor up to 0.3 N", 0.3, 1, false, false}, Set{"tremor up to 1 N", 1, 0.2, false, false},
                         Set{"declared textures", 0.3, 0.1, true, false},
                         Set{"250 Hz to 10 kHz, tremor up to 0.3 N", 0.3, 0.05, false, true}}) {
    Draw draw(seed + 1000);
    Silence damped, writing, ringing;
    while (damped.hours < hours * set.share) {
      Setting s = draw_setting(draw, 0.02, 0.5, set.tremor, set.any_rate);
      if (set.texture) {
        s.texture = draw(0.1, 0.5) * s.force;
        s.texture_hz = draw.log(25, 250);
      }
      (s.rings() ? ringing : s.activity == Activity::writing ? writing : damped).run(s, kRun);
    }
    if (damped.hours > 0) std::printf("%s\n", set.what);
    damped.print("ordinary activities");
    writing.print("writing at 8 Hz");
    ringing.print("loops that a knock rings");
    std::fflush(stdout);
  }
}
