#include "studies/ensemble_report.h"

#include "base/statistics.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace haptrace {
namespace {

using namespace ensemble;
using nlohmann::json;

/// Returns `figure` of each of `items`.
template <class Items, class Figure>
std::vector<double> column(const Items& items, Figure figure) {
  std::vector<double> values;
  for (const auto& item : items) values.push_back(static_cast<double>(std::invoke(figure, item)));
  return values;
}

template <class Items, class Figure>
Distribution distribution(const Items& items, Figure figure) {
  return Distribution::of(column(items, figure));
}

/// Run of one controller on one path, of a counted member.
struct CountedRun {
  std::uint64_t index;
  const EnsembleRun* run;
};

ControllerSummary summarise(const std::vector<CountedRun>& counted) {
  ControllerSummary summary;
  std::vector<EnsembleRun> whole;
  for (const auto& [index, run] : counted) {
    if (run->oscillations > 0) summary.oscillations.push_back(index);
    if (run->cause != StopCause::finished) {
      summary.stopped.push_back(index);
      continue;
    }
    if (run->limit_cycle()) summary.limit_cycles.push_back(index);
    if (run->overpowered()) summary.saturated.push_back(index);
    if (run->shakes()) summary.shaking.push_back(index);
    whole.push_back(*run);
  }
  summary.rms_error = distribution(whole, &EnsembleRun::rms_error);
  summary.peak_error = distribution(whole, &EnsembleRun::peak_error);
  summary.measured_rms_error = distribution(whole, &EnsembleRun::measured_rms_error);
  summary.measured_peak_error = distribution(whole, &EnsembleRun::measured_peak_error);
  summary.force_ripple = distribution(whole, &EnsembleRun::force_ripple);
  summary.ripple = distribution(whole, &EnsembleRun::ripple);
  return summary;
}

/// Returns the ratio of a controller's `figure` to that of the calibrated playback; NaN unless both finished.
double ratio(const EnsembleMember& member, EnsembleController controller, std::size_t path,
             double EnsembleRun::*figure) {
  if (!member.calibrated()) return kNaN;
  const EnsembleRun &theirs = member.trial(controller).runs[path],
                    &ours = member.trial(EnsembleController::calibrated).runs[path];
  const bool whole = theirs.cause == StopCause::finished && ours.cause == StopCause::finished;
  return whole ? theirs.*figure / ours.*figure : kNaN;
}

/// Summarises the members that `counts` accepts.
template <class Counts>
PathSummary summarise(const EnsembleReport& report, std::size_t path, Counts counts) {
  PathSummary summary{.name = report.paths[path]};
  std::array<std::vector<CountedRun>, kEnsembleControllers.size()> counted;
  std::vector<double> over_stiff, over_cautious, ripple;
  for (const EnsembleMember& member : report.members) {
    if (!counts(member)) continue;
    if (member.beyond_force(path)) {
      summary.beyond_force.push_back(member.index);
      continue;
    }
    ++summary.counted;
    for (std::size_t c = 0; c < counted.size(); ++c)
      if (!member.trials[c].runs.empty()) counted[c].push_back({member.index, &member.trials[c].runs[path]});
    over_stiff.push_back(ratio(member, EnsembleController::stiff, path, &EnsembleRun::rms_error));
    over_cautious.push_back(ratio(member, EnsembleController::cautious, path, &EnsembleRun::rms_error));
    ripple.push_back(1 / ratio(member, EnsembleController::stiff, path, &EnsembleRun::force_ripple));
  }
  for (std::size_t c = 0; c < counted.size(); ++c) summary.controllers[c] = summarise(counted[c]);
  summary.stiff_over_calibrated = Distribution::of(over_stiff);
  summary.cautious_over_calibrated = Distribution::of(over_cautious);
  summary.ripple_over_stiff = Distribution::of(ripple);
  return summary;
}

std::vector<KindSummary> summarise_kinds(const EnsembleReport& report) {
  std::vector<KindSummary> kinds;
  for (std::size_t k = 0; k < kEnsembleKinds; ++k) {
    KindSummary summary{.kind = static_cast<EnsembleKind>(k)};
    const auto of_kind = [&](const EnsembleMember& member) { return member.kind == summary.kind; };
    summary.draws = static_cast<std::size_t>(std::count_if(report.members.begin(), report.members.end(), of_kind));
    if (summary.draws == 0) continue;
    for (std::size_t path = 0; path < report.paths.size(); ++path)
      summary.paths.push_back(summarise(report, path, of_kind));
    kinds.push_back(std::move(summary));
  }
  return kinds;
}

HoldSummary summarise_hold(const EnsembleReport& report, EnsembleController controller) {
  HoldSummary summary;
  std::vector<EnsembleHold> whole;
  for (const EnsembleMember& member : report.members) {
    if (controller == EnsembleController::calibrated && !member.calibrated()) continue;
    const EnsembleHold& hold = member.trial(controller).hold;
    if (hold.oscillations > 0) summary.oscillations.push_back(member.index);
    if (hold.cause != StopCause::finished) {
      summary.stopped.push_back(member.index);
      continue;
    }
    if (hold.limit_cycle()) summary.limit_cycles.push_back(member.index);
    whole.push_back(hold);
  }
  summary.ripple = distribution(whole, &EnsembleHold::ripple);
  summary.hunting = distribution(whole, &EnsembleHold::hunting);
  return summary;
}

OverdriveSummary summarise_overdrive(const EnsembleReport& report) {
  OverdriveSummary summary;
  std::vector<double> delays;
  for (const EnsembleMember& member : report.members) {
    const EnsembleOverdrive& overdrive = member.overdrive;
    const bool stopped = overdrive.cause != StopCause::finished;
    if (stopped) summary.stopped.push_back(member.index);
    if (!overdrive.oscillates()) continue;
    summary.oscillating.push_back(member.index);
    if (overdrive.delay() > kCatchWithin) summary.late.push_back(member.index);
    if (!overdrive.calm && !stopped) summary.uncalm.push_back(member.index);
    delays.push_back(overdrive.delay());
  }
  summary.delay = Distribution::of(delays);
  return summary;
}

json to_json(const ControllerSummary& summary) {
  return {{"rms_error_m", to_json(summary.rms_error)},
          {"peak_error_m", to_json(summary.peak_error)},
          {"measured_rms_error_m", to_json(summary.measured_rms_error)},
          {"measured_peak_error_m", to_json(summary.measured_peak_error)},
          {"force_ripple_n", to_json(summary.force_ripple)},
          {"position_ripple_m", to_json(summary.ripple)},
          {"stopped", summary.stopped},
          {"limit_cycles", summary.limit_cycles},
          {"oscillations_noticed", summary.oscillations},
          {"saturated", summary.saturated},
          {"shaking", summary.shaking}};
}

json to_json(const PathSummary& summary) {
  json controllers;
  for (const EnsembleController controller : kEnsembleControllers)
    controllers[to_string(controller)] = to_json(summary.controllers[static_cast<std::size_t>(controller)]);
  return {{"path", summary.name},
          {"counted", summary.counted},
          {"beyond_force", summary.beyond_force},
          {"controllers", controllers},
          {"stiff_over_calibrated", to_json(summary.stiff_over_calibrated)},
          {"cautious_over_calibrated", to_json(summary.cautious_over_calibrated)},
          {"calibrated_ripple_over_stiff", to_json(summary.ripple_over_stiff)}};
}

json to_json(const KindSummary& summary) {
  json paths = json::array();
  for (const PathSummary& path : summary.paths) paths.push_back(to_json(path));
  return {{"kind", to_string(summary.kind)}, {"draws", summary.draws}, {"paths", paths}};
}

json to_json(const HoldSummary& summary) {
  return {{"ripple_m", to_json(summary.ripple)},
          {"hunting_m", to_json(summary.hunting)},
          {"stopped", summary.stopped},
          {"limit_cycles", summary.limit_cycles},
          {"oscillations_noticed", summary.oscillations}};
}

json to_json(const OverdriveSummary& summary) {
  return {{"oscillating", summary.oscillating.size()},
          {"noticed_after_s", to_json(summary.delay)},
          {"late_or_never", summary.late},
          {"still_oscillating", summary.uncalm},
          {"stopped", summary.stopped}};
}

json criteria() {
  return {{"moving_ripple_above_hz", kRippleCutoff},
          {"moving_limit_cycle_m", kMostRipple},
          {"hold_s", kHold},
          {"hold_judged_s", kHoldJudged},
          {"hold_ripple_above_hz", kHoldRippleCutoff},
          {"hold_limit_cycle_m", kMostHoldRipple},
          {"hold_hunting_above_hz", kHuntingCutoff},
          {"hold_hunting_m", kMostHunting},
          {"saturated_share", kMostSaturated},
          {"noticed_within_s", kCatchWithin},
          {"shaking_m", kMostShaking},
          {"shaking_window_s", kShakingWindow}};
}

// --- Plot -----------------------------------------------------------------------------------------------------------

constexpr double kLeastDrawn = 1e-4;  // smallest value drawn, in units; smaller ones are drawn as this

/// Returns the cumulative distribution of the decimal logarithm of `values` in `unit`: the share of the draws [%] with
/// at most that value.
Series cumulative(std::vector<double> values, double unit, std::string label, int color) {
  std::erase_if(values, [](double value) { return !std::isfinite(value); });
  std::sort(values.begin(), values.end());
  Series series{.label = std::move(label), .color = color, .width = 1.6};
  const auto n = static_cast<double>(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    series.x.push_back(std::log10(std::max(values[i] / unit, kLeastDrawn)));
    series.y.push_back(100 * static_cast<double>(i + 1) / n);
  }
  return series;
}

Panel panel(std::string title, std::string x_label, bool first) {
  return {.title = std::move(title),
          .x_label = std::move(x_label),
          .y_label = first ? "cumulative share of the draws [%]" : "",
          .y_range = std::pair{0.0, 100.0}};
}

int color_of(EnsembleController controller) {
  switch (controller) {
    case EnsembleController::stiff:
      return 0;
    case EnsembleController::cautious:
      return 5;
    case EnsembleController::calibrated:
      return 2;
  }
  return 7;
}

/// Returns `figure` of the counted runs of one controller on a path.
template <class Figure>
std::vector<double> counted(const EnsembleReport& report, std::size_t path, EnsembleController controller,
                            Figure figure) {
  std::vector<double> values;
  for (const EnsembleMember& member : report.members) {
    const EnsembleTrial& trial = member.trial(controller);
    if (trial.runs.empty() || member.beyond_force(path) || trial.runs[path].cause != StopCause::finished) continue;
    values.push_back(std::invoke(figure, trial.runs[path]));
  }
  return values;
}

template <class Figure>
std::vector<Panel> panels(const EnsembleReport& report, const std::string& what, const std::string& x_label,
                          double unit, Figure figure) {
  std::vector<Panel> row;
  for (std::size_t path = 0; path < report.paths.size(); ++path) {
    row.push_back(panel(fmt::format("{}: {}", report.paths[path], what), x_label, path == 0));
    for (const EnsembleController controller : kEnsembleControllers)
      row.back().series.push_back(
          cumulative(counted(report, path, controller, figure), unit, to_string(controller), color_of(controller)));
  }
  return row;
}

template <class Figure>
Panel hold_panel(const EnsembleReport& report, const std::string& title, bool first, Figure figure) {
  Panel p = panel(title, "log10 of mm", first);
  for (const EnsembleController controller : kEnsembleControllers) {
    std::vector<double> values;
    for (const EnsembleMember& member : report.members)
      if (!member.trial(controller).runs.empty() && member.trial(controller).hold.cause == StopCause::finished)
        values.push_back(std::invoke(figure, member.trial(controller).hold));
    p.series.push_back(cumulative(values, 1e-3, to_string(controller), color_of(controller)));
  }
  return p;
}

/// Returns `figure` of every path of a kind.
template <class Figure>
std::string of_paths(const KindSummary& kind, const char* format, Figure figure) {
  std::vector<std::string> texts;
  for (const PathSummary& path : kind.paths) texts.push_back(fmt::format(fmt::runtime(format), figure(path)));
  return fmt::format("{}", fmt::join(texts, " "));
}

std::string text_of(const std::vector<KindSummary>& kinds) {
  std::string text =
      "  by kind: draws; how many times as accurate as stiff on each path, and least; force ripple over that of "
      "stiff;\n"
      "  draws that shake the hand\n";
  for (const KindSummary& kind : kinds) {
    double least = std::numeric_limits<double>::infinity();
    std::size_t shaking = 0;
    for (const PathSummary& path : kind.paths) {
      least = std::min(least, path.stiff_over_calibrated.min);
      shaking += path.controllers[static_cast<std::size_t>(EnsembleController::calibrated)].shaking.size();
    }
    text += fmt::format(
        "    {:<20} {:>3}  {} ({:.1f})  {}  {}\n", to_string(kind.kind), kind.draws,
        of_paths(kind, "{:5.1f}", [](const PathSummary& path) { return path.stiff_over_calibrated.median; }), least,
        of_paths(kind, "{:.2f}", [](const PathSummary& path) { return path.ripple_over_stiff.median; }), shaking);
  }
  return text;
}

std::string millimetres(const Distribution& d) {
  return fmt::format("{:.3f} {:.3f} {:.3f}", 1e3 * d.median, 1e3 * d.p95, 1e3 * d.max);
}

}  // namespace

Distribution Distribution::of(std::vector<double> values) {
  std::erase_if(values, [](double value) { return !std::isfinite(value); });
  if (values.empty()) return {};
  return {.count = values.size(),
          .median = haptrace::median(values),
          .p5 = quantile(values, 0.05),
          .p95 = quantile(values, 0.95),
          .max = quantile(values, 1),
          .min = quantile(values, 0)};
}

json to_json(const Distribution& d) {
  return {{"count", d.count}, {"median", d.median}, {"p5", d.p5}, {"p95", d.p95}, {"max", d.max}, {"min", d.min}};
}

EnsembleSummary summarise(const EnsembleReport& report) {
  EnsembleSummary summary;
  for (const EnsembleMember& member : report.members)
    if (!member.calibrated()) summary.not_calibrated.push_back(member.index);
  const auto all = [](const EnsembleMember&) { return true; };
  for (std::size_t path = 0; path < report.paths.size(); ++path) summary.paths.push_back(summarise(report, path, all));
  for (const EnsembleController controller : kEnsembleControllers)
    summary.holds[static_cast<std::size_t>(controller)] = summarise_hold(report, controller);
  summary.overdrive = summarise_overdrive(report);
  summary.kinds = summarise_kinds(report);
  return summary;
}

json to_json(const EnsembleReport& report) {
  const EnsembleSummary summary = summarise(report);
  json paths = json::array(), kinds = json::array(), holds, errors;
  for (const PathSummary& path : summary.paths) paths.push_back(to_json(path));
  for (const KindSummary& kind : summary.kinds) kinds.push_back(to_json(kind));
  for (const EnsembleController controller : kEnsembleControllers)
    holds[to_string(controller)] = to_json(summary.holds[static_cast<std::size_t>(controller)]);
  for (const EnsembleMember& member : report.members)
    if (!member.calibrated()) errors[std::to_string(member.index)] = member.calibration_error;
  return {{"seed", report.seed},
          {"draws_asked", report.draws},
          {"draws", report.members.size()},
          {"learning_repetitions", report.learn},
          {"not_calibrated", errors.is_null() ? json::object() : errors},
          {"paths", paths},
          {"kinds", kinds},
          {"hold", holds},
          {"beyond_stable_gains", to_json(summary.overdrive)},
          {"criteria", criteria()}};
}

Figure figure_of(const EnsembleReport& report) {
  Figure figure{.title = fmt::format("{} random devices and hands", report.members.size()),
                .caption = fmt::format(
                    "Seed {}. stiff: 3000 N/m, 25 N s/m; cautious: 500 N/m, 6 N s/m; calibrated: identified without "
                    "prior knowledge, then {} learning repetitions. Draws that need more force than the "
                    "device has are left out.",
                    report.seed, report.learn)};
  figure.rows = {panels(report, "true error, rms", "log10 of mm", 1e-3, &EnsembleRun::rms_error),
                 panels(report, "force ripple above 25 Hz, rms", "log10 of N", 1, &EnsembleRun::force_ripple),
                 panels(report, "true ripple above 25 Hz, rms", "log10 of mm", 1e-3, &EnsembleRun::ripple),
                 {hold_panel(report, "hold: true ripple above 20 Hz, rms", true, &EnsembleHold::ripple),
                  hold_panel(report, "hold: true ripple above 2 Hz, rms", false, &EnsembleHold::hunting)}};
  figure.width = std::max(960.0, std::min(420.0 * static_cast<double>(report.paths.size()), 8000.0));
  figure.height = 1100;
  return figure;
}

std::string text_of(const EnsembleReport& report) {
  const EnsembleSummary summary = summarise(report);
  const std::string kind = report.kinds.size() == 1 ? to_string(report.kinds.front()) : "hard";
  std::string text =
      fmt::format("{} of {} random devices and hands ({}), seed {}; true rms error in mm: median, p95, max\n",
                  report.members.size(), report.draws, kind, report.seed);
  for (const PathSummary& path : summary.paths) {
    text += fmt::format("  {}: {} draws; {} more need more force than the device has\n", path.name, path.counted,
                        path.beyond_force.size());
    for (const EnsembleController controller : kEnsembleControllers) {
      const ControllerSummary& c = path.controllers[static_cast<std::size_t>(controller)];
      text += fmt::format(
          "    {:<10}  {}  force ripple {:.2f} N  limit cycles {}, stopped {}, saturated {}, oscillations noticed {}\n",
          to_string(controller), millimetres(c.rms_error), c.force_ripple.median, c.limit_cycles.size(),
          c.stopped.size(), c.saturated.size(), c.oscillations.size());
    }
    text += fmt::format(
        "    calibrated is {:.1f} times as accurate as stiff and {:.1f} times as accurate as cautious (medians)\n",
        path.stiff_over_calibrated.median, path.cautious_over_calibrated.median);
  }
  if (report.kinds.size() > 1) text += text_of(summary.kinds);
  for (const EnsembleController controller : kEnsembleControllers) {
    const HoldSummary& hold = summary.holds[static_cast<std::size_t>(controller)];
    text +=
        fmt::format("  hold, {:<10}  ripple {}  hunting {}  limit cycles {}, stopped {}\n", to_string(controller),
                    millimetres(hold.ripple), millimetres(hold.hunting), hold.limit_cycles.size(), hold.stopped.size());
  }
  const OverdriveSummary& beyond = summary.overdrive;
  text += fmt::format(
      "  gains beyond the stable range: {} oscillate, noticed after {:.3f} s (p95 {:.3f}); late or never {}, still "
      "oscillating {}, stopped {}\n",
      beyond.oscillating.size(), beyond.delay.median, beyond.delay.p95, beyond.late.size(), beyond.uncalm.size(),
      beyond.stopped.size());
  if (!summary.not_calibrated.empty())
    text += fmt::format("  not calibrated: {}\n", fmt::join(summary.not_calibrated, ", "));
  return text;
}

}  // namespace haptrace
