#include "player/tuning/live_tuning.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/number.h"
#include "base/suggest.h"
#include "control/pd.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

namespace haptrace {
namespace {

constexpr double kLowestBandwidth = 0.01;  // [Hz]

const std::vector<std::string> kQuantities{"kp",      "kd",       "gains",    "inertia",     "gravity",    "friction",
                                           "cogging", "observer", "learning", "feedforward", "observer_hz"};
constexpr const char* kHelp =
    "kp X | kp X Y Z | kd X | kd X Y Z [SI] ; gains * F | gains / F ; "
    "inertia, gravity, friction, cogging, feedforward, observer, learning: SHARE 0 to 1 | on | off | toggle ; "
    "observer_hz HZ";

/// The shares that a name stands for; none for a name of something else.
std::vector<CompensationTerm> shares_of(std::string_view name) {
  std::vector<CompensationTerm> shares;
  for (const CompensationTerm& share : kCompensationTerms)
    if (name == share.name || (name == "feedforward" && share.feedforward)) shares.push_back(share);
  return shares;
}

std::string gain_text(const Vec3& v, bool brief) {
  return brief && (v.array() == v[0]).all() ? fmt::format("{:.6g}", v[0])
                                            : fmt::format("{:.6g} {:.6g} {:.6g}", v[0], v[1], v[2]);
}

std::string gain_text(const PdGains& gains, bool brief) {
  return fmt::format("kp {} kd {}", gain_text(gains.kp, brief), gain_text(gains.kd, brief));
}

/// Returns the largest factor that keeps every gain within its limit, but at least 1: scaling up never scales down.
double largest_factor(const PdGains& gains, const PdGains& largest) {
  double factor = std::numeric_limits<double>::infinity();
  for (const auto& [gain, limit] : {std::pair{&gains.kp, &largest.kp}, std::pair{&gains.kd, &largest.kd}})
    for (int axis = 0; axis < 3; ++axis)
      if ((*gain)[axis] > 0) factor = std::min(factor, (*limit)[axis] / (*gain)[axis]);
  return std::max(1.0, factor);
}

}  // namespace

TuningLimits limits_of_unidentified(double max_force, double rate_hz) {
  constexpr double kTimes = 10;
  const PdGains cautious = cautious_gains(max_force, rate_hz);
  return {.largest = {(kTimes * cautious.kp).cwiseMin(kLargestKp), (kTimes * cautious.kd).cwiseMin(kLargestKd)},
          .because = "limit without a calibration or --expert"};
}

LiveTuning::LiveTuning(const Tuning& start, Options options)
    : LiveSession({.annotations = options.annotations, .stop = options.stop, .endless = options.endless}),
      start_(start),
      options_([&] {
        validate(start.gains);
        options.limits.largest.kp = options.limits.largest.kp.cwiseMax(start.gains.kp).cwiseMin(kLargestKp);
        options.limits.largest.kd = options.limits.largest.kd.cwiseMax(start.gains.kd).cwiseMin(kLargestKd);
        options.limits.observer_hz = std::max(options.limits.observer_hz, start.observer_hz);
        return std::move(options);
      }()),
      wanted_(start),
      mailbox_(start) {}

const std::vector<std::string>& LiveTuning::quantities() const {
  return kQuantities;
}

std::string LiveTuning::help() const {
  return kHelp;
}

std::string LiveTuning::reset() {
  put_in_force(start_, "reset", "reset to " + text_of("gains", start_, true));
  return text_of("gains", start_, false);
}

std::string LiveTuning::change(const std::string& name, Words values) {
  Tuning tuning = wanted_;
  std::string clamped;
  if (name == "kp" || name == "kd")
    clamped = set_gain(name, values, tuning);
  else if (name == "gains")
    clamped = scale_gains(values, tuning);
  else if (name == "observer_hz")
    clamped = set_bandwidth(values, tuning);
  else
    set_shares(name, values, tuning);
  put_in_force(tuning, name, text_of(name, tuning, true));
  return text_of(name, tuning, false) + clamped;
}

std::string LiveTuning::set_gain(const std::string& name, Words values, Tuning& tuning) const {
  if (values.size() != 1 && values.size() != 3)
    throw input_error(fmt::format("{} takes one number for all axes, or three numbers x y z", name));
  Vec3 asked;
  for (int axis = 0; axis < 3; ++axis)
    asked[axis] = finite_number(name, values[values.size() == 3 ? static_cast<std::size_t>(axis) : 0]);
  if ((asked.array() < 0).any()) throw input_error(fmt::format("{} is negative; it must be at least 0", name));

  const Vec3 PdGains::*gain = name == "kp" ? &PdGains::kp : &PdGains::kd;
  const Vec3& largest = options_.limits.largest.*gain;
  const Vec3 borne = asked.cwiseMin(largest);
  (name == "kp" ? tuning.gains.kp : tuning.gains.kd) = borne;
  if (borne == asked) return {};
  return fmt::format(" clamped from {}: {} is the {}", gain_text(asked, true), gain_text(largest, true),
                     options_.limits.because);
}

std::string LiveTuning::scale_gains(Words values, Tuning& tuning) const {
  const std::optional<double> factor_asked = factor_of("gains", values);
  if (!factor_asked) throw input_error("gains take a factor, as in gains * 1.1 or gains / 1.1; kp and kd take values");
  const double asked = *factor_asked;

  // All gains have the same factor, so that their ratios stay.
  const double factor = std::min(asked, largest_factor(tuning.gains, options_.limits.largest));
  tuning.gains.kp = (factor * tuning.gains.kp).cwiseMin(options_.limits.largest.kp);
  tuning.gains.kd = (factor * tuning.gains.kd).cwiseMin(options_.limits.largest.kd);
  if (factor == asked) return {};
  return fmt::format(" clamped from * {:.6g}: {} is the {}", asked, gain_text(options_.limits.largest, true),
                     options_.limits.because);
}

std::string LiveTuning::set_bandwidth(Words values, Tuning& tuning) const {
  require_composed("observer");
  if (values.size() != 1) throw input_error("observer_hz takes one number [Hz]");
  const double asked = finite_number("observer_hz", values[0]);
  if (asked < kLowestBandwidth)
    throw input_error(
        fmt::format("observer_hz must be at least {} Hz; 'observer off' switches it off", kLowestBandwidth));
  tuning.observer_hz = std::min(asked, options_.limits.observer_hz);
  if (tuning.observer_hz == asked) return {};
  return fmt::format(" clamped from {:.6g}: {:.6g} is the {}", asked, options_.limits.observer_hz,
                     options_.limits.because);
}

void LiveTuning::set_shares(const std::string& name, Words values, Tuning& tuning) const {
  require_composed(name);
  if (values.size() != 1) throw input_error(fmt::format("{} takes a share from 0 to 1, on, off or toggle", name));
  std::vector<CompensationTerm> shares = shares_of(name);
  std::erase_if(shares, [&](const CompensationTerm& share) { return !(options_.composed.*share.composed); });
  const bool acts =
      std::any_of(shares.begin(), shares.end(), [&](const CompensationTerm& s) { return tuning.*s.share > 0; });
  for (const CompensationTerm& share : shares) {
    const double full = start_.*share.share > 0 ? start_.*share.share : 1;
    if (values[0] == "on" || (values[0] == "toggle" && !acts)) {
      tuning.*share.share = full;
    } else if (values[0] == "off" || values[0] == "toggle") {
      tuning.*share.share = 0;
    } else {
      const double asked = finite_number(name, values[0]);
      if (!(asked >= 0 && asked <= 1))
        throw input_error(fmt::format("{} {} is not a share from 0 (none) to 1 (all)", name, values[0]));
      tuning.*share.share = asked;
    }
  }
}

void LiveTuning::require_composed(const std::string& name) const {
  for (const CompensationTerm& share : shares_of(name))
    if (options_.composed.*share.composed) return;
  throw input_error(fmt::format("{}: not part of this session; {}", name, options_.remedy));
}

std::string LiveTuning::text_of(const std::string& name, const Tuning& tuning, bool brief) const {
  if (name == "kp") return "kp " + gain_text(tuning.gains.kp, brief);
  if (name == "kd") return "kd " + gain_text(tuning.gains.kd, brief);
  if (name == "gains") return gain_text(tuning.gains, brief);
  if (name == "observer_hz") {
    require_composed("observer");
    return fmt::format("observer_hz {:.6g}", tuning.observer_hz);
  }
  require_composed(name);
  std::string text;
  for (const CompensationTerm& share : shares_of(name))
    if (options_.composed.*share.composed)
      text += fmt::format("{}{} {:.6g}", text.empty() ? "" : " ", share.name, tuning.*share.share);
  return text;
}

nlohmann::json LiveTuning::state(const Tuning& tuning) const {
  nlohmann::json json{{"kp", json_of(tuning.gains.kp)}, {"kd", json_of(tuning.gains.kd)}};
  json["limits"] = {{"kp", json_of(options_.limits.largest.kp)}, {"kd", json_of(options_.limits.largest.kd)}};
  for (const CompensationTerm& share : kCompensationTerms)
    if (options_.composed.*share.composed) json[share.name] = tuning.*share.share;
  if (options_.composed.observer) {
    json["observer_hz"] = tuning.observer_hz;
    json["limits"]["observer_hz"] = options_.limits.observer_hz;
  }
  return json;
}

void LiveTuning::put_in_force(const Tuning& tuning, const std::string& subject, const std::string& text) {
  if (state(tuning) == state(wanted_)) return;
  wanted_ = tuning;
  changed_ = true;
  mailbox_.post(tuning);

  log_change(subject, text);
}

Tuning LiveTuning::wanted() const {
  const std::lock_guard lock(mutex());
  return wanted_;
}

bool LiveTuning::changed() const {
  const std::lock_guard lock(mutex());
  return changed_;
}

std::string LiveTuning::summarise() const {
  std::string text = text_of("gains", wanted_, true);
  for (const CompensationTerm& share : kCompensationTerms)
    if (const double value = wanted_.*share.share; options_.composed.*share.composed && value != 1)
      text += value == 0 ? fmt::format(" {} off", share.name) : fmt::format(" {} {:.3g}", share.name, value);
  return text;
}

std::vector<LiveControl> LiveTuning::list_controls() const {
  static const std::map<std::string, std::string> kLabels{
      {"inertia", "Compensation of inertia"},   {"gravity", "Compensation of gravity"},
      {"friction", "Compensation of friction"}, {"cogging", "Compensation of cogging"},
      {"observer", "Disturbance observer"},     {"learning", "Learned force"}};
  constexpr double kRatio = 1.1;   // of a button, as of a key in the terminal
  constexpr double kFirst = 1e-2;  // first step from 0, as a share of the largest value
  std::vector<LiveControl> controls;
  // One number changes all axes, and so would hide that they differ.
  bool differ = false;
  const auto add_gain = [&](const char* name, const char* label, const char* unit, const Vec3& gain, const Vec3& most) {
    if (!(gain.array() == gain[0]).all()) {
      differ = true;
      return;
    }
    const double largest = most.maxCoeff();
    controls.push_back({.name = name,
                        .label = label,
                        .unit = unit,
                        .value = gain[0],
                        .largest = largest,
                        .step = gain[0] > 0 ? (kRatio - 1) * gain[0] : kFirst * largest,
                        .ratio = kRatio,
                        .because = options_.limits.because});
  };
  const PdGains &gains = wanted_.gains, &largest = options_.limits.largest;
  add_gain("kp", "Stiffness", "N/m", gains.kp, largest.kp);
  add_gain("kd", "Damping", "N s/m", gains.kd, largest.kd);
  if (differ)
    controls.push_back({.name = "gains",
                        .label = "Stiffness and damping",
                        .unit = "",
                        .ratio = kRatio,
                        .because = "the gains of the axes differ",
                        .kind = LiveControl::Kind::factor,
                        .text = gain_text(gains, true)});
  for (const CompensationTerm& share : kCompensationTerms)
    if (options_.composed.*share.composed)
      controls.push_back({.name = share.name,
                          .label = kLabels.at(share.name),
                          .unit = "",
                          .value = wanted_.*share.share,
                          .because = ""});
  if (options_.composed.observer)
    controls.push_back({.name = "observer_hz",
                        .label = "Bandwidth of the disturbance observer",
                        .unit = "Hz",
                        .value = wanted_.observer_hz,
                        .least = kLowestBandwidth,
                        .largest = options_.limits.observer_hz,
                        .step = 1,
                        .because = options_.limits.because});
  return controls;
}

}  // namespace haptrace
