#include "studies/trade/trade_report.h"

#include "base/json_reader.h"
#include "base/number.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

std::string number_or(double value, const char* format, const char* otherwise = "-") {
  return std::isfinite(value) ? fmt::format(fmt::runtime(format), value) : otherwise;
}

std::string table_row(const std::string& name, const Outcome& o, const char* mark = " ") {
  if (!o.ran()) return fmt::format("  {}{:<22} refused: {}\n", mark, name, o.refused);
  return fmt::format("  {}{:<22} {:>7.4f} +-{:<7} {:>7.3f}  {:>6} {:>7.3f}  {:>5}  {:>7}  {:>7}  {:>6}  {:>6}  {:>5}\n",
                     mark, name, 1e3 * o.error.mean, number_or(1e3 * o.error.half_width, "{:.4f}", "?"),
                     1e3 * o.peak.mean, number_or(o.force.mean, "{:.3f}"), o.ripple.mean,
                     number_or(o.margin, o.margin >= 4 ? ">={:.0f}" : "{:.2f}"), number_or(1e9 * o.control, "{:.0f}"),
                     number_or(o.instructions, "{:.0f}"), number_or(1e6 * o.tick, "{:.2f}"),
                     number_or(1e3 * o.start, "{:.2f}"), number_or(1e-6 * o.bytes_per_hour, "{:.0f}"));
}

std::string table_head(const char* name) {
  return fmt::format("   {:<22} {:>7}   {:<7} {:>7}  {:>6} {:>7}  {:>5}  {:>7}  {:>7}  {:>6}  {:>6}  {:>5}\n", name,
                     "rms mm", "95 %", "peak mm", "force", "ripple", "gain", "ns/tick", "instr.", "us", "ms", "MB/h");
}

constexpr double kNoError = std::numeric_limits<double>::infinity();

/// Largest number of front configurations in the text report.
constexpr std::size_t kMostTold = 24;

Panel knob_panel(const KnobSweep& sweep, const char* x_label) {
  Panel panel{.title = sweep.what, .x_label = x_label, .y_label = "mm, N, us", .log_x = true, .log_y = true};
  Series error{.label = "error, rms", .color = 0, .width = 1.6}, peak{.label = "peak", .color = 4},
      ripple{.label = "force ripple", .color = 1}, tick{.label = "tick", .color = 2, .dashed = true};
  for (const KnobLevel& level : sweep.levels) {
    std::string_view rest = level.level;
    const double x = take_number<double>(rest).value_or(0);
    if (!level.outcome.ran()) continue;
    for (const auto& [series, value] : {std::pair{&error, level.outcome.error.mean / 1e-3},
                                        {&peak, level.outcome.peak.mean / 1e-3},
                                        {&ripple, level.outcome.ripple.mean / 1},
                                        {&tick, level.outcome.control / 1e-6}}) {
      series->x.push_back(x);
      series->y.push_back(value);
    }
  }
  panel.series = {error, peak, ripple, tick};
  return panel;
}

Panel front_panel(const TradeReport& report, const Choice* choice) {
  const bool counted = std::any_of(report.tried.begin(), report.tried.end(),
                                   [](const Outcome& o) { return std::isfinite(o.instructions); });
  Panel panel{.title = "all configurations and the Pareto front",
              .x_label = counted ? "load, million instructions per second" : "load, ms per second",
              .y_label = "error, rms, mm",
              .log_x = true,
              .log_y = true};
  const double scale = 1e6;
  const auto dot = [&](const Outcome& o, int color, double width, const char* label) {
    panel.series.push_back(
        {.label = label, .x = {o.load() / scale}, .y = {o.error.mean / 1e-3}, .color = color, .width = width});
  };
  bool told_plain = false, told_learned = false;
  for (const Outcome& o : report.tried) {
    if (!o.ran() || !(o.load() > 0)) continue;
    const bool learned = o.configuration.learn > 0;
    bool& told = learned ? told_learned : told_plain;
    dot(o, learned ? 5 : 4, 1, told ? "" : learned ? "learned" : "tried");
    told = true;
  }
  // The line contains only front configurations that improve the error; the others are there for their ripple.
  Series front{.label = "front", .color = 0, .width = 1.6},
      learned{.label = "front, learned", .color = 1, .width = 1.6};
  double least = kNoError, least_learned = kNoError;
  for (const Outcome& o : report.front) {
    const bool is_learned = o.configuration.learn > 0;
    double& best = is_learned ? least_learned : least;
    if (!(o.load() > 0) || o.error.mean >= best) continue;
    best = o.error.mean;
    Series& line = is_learned ? learned : front;
    line.x.push_back(o.load() / scale);
    line.y.push_back(o.error.mean / 1e-3);
  }
  for (Series* line : {&front, &learned})
    if (!line->x.empty()) panel.series.push_back(*line);
  if (choice != nullptr) dot(choice->outcome, 7, 3, "chosen");
  return panel;
}

}  // namespace

nlohmann::json predicted_by(const Outcome& outcome) {
  return {{"rms_error_m", json_of_number(outcome.rms_error.mean)},
          {"peak_error_m", json_of_number(outcome.peak_error.mean)},
          {"force_ripple_n", json_of_number(outcome.ripple.mean)},
          {"max_force_n", json_of_number(outcome.max_force.mean)},
          {"tick_s", {{"p50", json_of_number(outcome.tick)}}},
          {"duration_s", outcome.duration},
          {"confidence", 0.95},
          {"half_width",
           {{"rms_error_m", json_of_number(outcome.rms_error.half_width)},
            {"peak_error_m", json_of_number(outcome.peak_error.half_width)},
            {"force_ripple_n", json_of_number(outcome.ripple.half_width)}}}};
}

nlohmann::json to_json(const TermPrice& price) {
  return {{"term", price.term},
          {"without", to_json(price.without)},
          {"error_change_m", json_of_number(price.error_change)},
          {"ripple_change_n", json_of_number(price.ripple_change)},
          {"instructions_saved", json_of_number(price.instructions)},
          {"control_saved_s", json_of_number(price.control)},
          {"dispensable", price.dispensable}};
}

nlohmann::json to_json(const Explanation& explanation) {
  nlohmann::json terms = nlohmann::json::array();
  for (const TermPrice& price : explanation.terms) terms.push_back(to_json(price));
  return {{"of", to_json(explanation.of)}, {"terms", terms}};
}

nlohmann::json to_json(const Choice& choice, const Budget& budget) {
  nlohmann::json json{{"budget", to_string(budget)}, {"kept", choice.kept}, {"outcome", to_json(choice.outcome)}};
  if (!choice.binding.empty()) {
    json["binding"] = choice.binding;
    json["binding_ratio"] = json_of_number(choice.binding_ratio);
    if (!choice.excludes.empty()) json["excludes"] = choice.excludes;
    json["implied"] = choice.implied;
  }
  if (choice.storage) json["storage"] = choice.storage->name;
  if (choice.cheaper) json["cheaper"] = to_json(*choice.cheaper);
  if (choice.dearer) json["dearer"] = to_json(*choice.dearer);
  return json;
}

nlohmann::json to_json(const TradeReport& report) {
  nlohmann::json sweeps = nlohmann::json::array();
  for (const KnobSweep& sweep : report.sweeps) {
    nlohmann::json levels = nlohmann::json::array();
    for (const KnobLevel& level : sweep.levels) {
      nlohmann::json one = to_json(level.outcome);
      one["level"] = level.level;
      one["base"] = level.is_base;
      levels.push_back(std::move(one));
    }
    sweeps.push_back({{"knob", sweep.knob}, {"what", sweep.what}, {"levels", levels}});
  }
  nlohmann::json sides = nlohmann::json::array();
  for (const SideTrade& side : report.sides) sides.push_back(to_json(side));
  nlohmann::json front = nlohmann::json::array();
  for (const Outcome& outcome : report.front) front.push_back(to_json(outcome));
  return {{"device", report.device},
          {"path", report.path},
          {"path_duration_s", report.path_duration},
          {"calibrated", report.calibrated},
          {"complete", report.complete},
          {"runs", report.options.runs},
          {"configurations_tried", report.tried.size()},
          {"base", to_json(report.base)},
          {"knobs", sweeps},
          {"sides", sides},
          {"front", front}};
}

std::string text_of(const TradeReport& report) {
  std::string text =
      fmt::format("{} on {}, {} configurations, {} runs of each\n  base: {}\n", report.path, report.device,
                  report.tried.size(), report.options.runs, describe(report.base.configuration));
  for (const KnobSweep& sweep : report.sweeps) {
    text += fmt::format("\n{}\n{}", sweep.what, table_head(sweep.knob.c_str()));
    for (const KnobLevel& level : sweep.levels)
      text += table_row(level.level, level.outcome, level.is_base ? "*" : " ");
  }
  for (const SideTrade& side : report.sides) text += text_of(side);
  text += fmt::format("\nthe Pareto front, cheapest first\n{}", table_head(""));
  const std::size_t told = std::min(report.front.size(), kMostTold);
  for (std::size_t i = 0; i < told; ++i) {
    const Outcome& outcome = report.front[told < 2 ? 0 : i * (report.front.size() - 1) / (told - 1)];
    text += fmt::format("  {}, load {}\n", describe(outcome.configuration), text_of_load(outcome));
    text += table_row("", outcome);
  }
  return text;
}

namespace {

/// Returns how much of its tightest bound the choice uses.
std::string used(const Choice& choice) {
  if (!std::isfinite(choice.binding_ratio)) return "its value is unknown";
  return fmt::format("{:.0f} % of it {} used", 100 * choice.binding_ratio, choice.kept ? "is" : "would be");
}

}  // namespace

std::string text_of(const Choice& choice, const Budget& budget) {
  const Outcome& o = choice.outcome;
  std::string text = fmt::format(
      "\n{} {}:\n  {}\n",
      budget.bounds_accuracy() ? "the cheapest configuration that keeps" : "the most accurate configuration that keeps",
      to_string(budget), describe(o.configuration));
  if (!choice.kept)
    text = fmt::format("\nno configuration keeps {}; the nearest is\n  {}\n", to_string(budget),
                       describe(o.configuration));
  const auto interval = [](const Estimate& estimate, double scale, int digits) {
    return fmt::format("{:.{}f} +-{}", estimate.mean / scale, digits,
                       number_or(estimate.half_width / scale, digits == 3 ? "{:.3f}" : "{:.4f}", "?"));
  };
  text += fmt::format("  predicted: rms {} mm, peak {} mm, ripple {} N (95 % intervals, {} runs), tick {}\n",
                      interval(o.rms_error, 1e-3, 4), interval(o.peak_error, 1e-3, 4), interval(o.ripple, 1, 3), o.runs,
                      text_of(Measure::tick, o.tick));
  for (const std::string& bound : choice.implied)
    text += fmt::format("  {} is kept as well: {}\n", bound,
                        bound.starts_with("ripple") ? "the ripple of the plain law, since the budget does not bound it"
                                                    : "gains need a reserve for other hands");
  if (choice.storage) text += fmt::format("  storage of recordings: {}\n", choice.storage->name);
  if (!choice.binding.empty()) text += fmt::format("  the tightest bound is {}: {}\n", choice.binding, used(choice));
  const auto step = [&](const char* which, const Outcome& other) {
    const double load = other.load() / o.load() - 1, error = other.error.mean / o.error.mean - 1;
    text += fmt::format("  the next {} configuration: load {:+.0f} %, error {:+.0f} %: {}\n", which, 100 * load,
                        100 * error, describe(other.configuration));
  };
  if (!choice.excludes.empty())
    text += fmt::format("  the next {} configuration breaks {}\n",
                        budget.bounds_accuracy() ? "cheaper" : "more expensive", choice.excludes);
  if (choice.cheaper) step("cheaper", *choice.cheaper);
  if (choice.dearer) step("more expensive", *choice.dearer);
  return text;
}

std::string text_of(const Explanation& explanation, const Budget& budget, const char* what) {
  std::string text = fmt::format("\n{}\n  each {} left out in turn: changes and savings\n",
                                 describe(explanation.of.configuration), what);
  for (const TermPrice& price : explanation.terms) {
    if (!price.without.ran()) {
      text += fmt::format("  {:<20} refused: {}\n", price.term, price.without.refused);
      continue;
    }
    // Instructions repeat from run to run, and the time of a tick does not.
    const bool counted = std::isfinite(price.instructions);
    const double saved = counted ? price.instructions : 1e9 * price.control;
    text += fmt::format(
        "  {:<20} error {:+.4f} mm, ripple {:+.3f} N; {} {} {} a tick{}\n", price.term, 1e3 * price.error_change,
        price.ripple_change, saved < 0 ? "costs" : "saves", number_or(std::abs(saved), "{:.0f}"),
        counted ? "instructions" : "ns",
        price.dispensable ? fmt::format("; it can be dropped, the change is smaller than {}", to_string(budget)) : "");
  }
  return text;
}

Figure figure_of(const TradeReport& report, const Choice* choice) {
  Figure figure{.title = "speed against accuracy",
                .caption = fmt::format("{} on {}. Base: {}. {} runs of each configuration{}.", report.path,
                                       report.device, describe(report.base.configuration), report.options.runs,
                                       report.complete ? "" : "; incomplete"),
                .rows = {{front_panel(report, choice)}, {}},
                .width = 1100,
                .height = 900};
  for (const KnobSweep& sweep : report.sweeps) {
    if (sweep.knob == "rate") figure.rows[1].push_back(knob_panel(sweep, "Hz"));
    if (sweep.knob == "thin") figure.rows[1].push_back(knob_panel(sweep, "samples per stored sample"));
    if (sweep.knob == "speed") figure.rows[1].push_back(knob_panel(sweep, "speed relative to the path"));
  }
  if (figure.rows[1].empty()) figure.rows.pop_back();
  return figure;
}

}  // namespace haptrace
