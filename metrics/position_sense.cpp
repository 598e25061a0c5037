#include "metrics/position_sense.h"

#include "base/json_reader.h"
#include "metrics/recorded_trial.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

double probability_of_second(double difference, double bias, double spread) {
  return 0.5 * SenseFit::kLapse + (1 - SenseFit::kLapse) / (1 + std::exp(-(difference - bias) / spread));
}

double log_likelihood(std::span<const SenseAnswer> answers, double bias, double spread) {
  double sum = 0;
  for (const SenseAnswer& one : answers) {
    const double p = probability_of_second(one.difference, bias, spread);
    sum += std::log(one.second ? p : 1 - p);
  }
  return sum;
}

/// Threshold over the spread s.
double threshold_of_spread() {
  const double share = (0.75 - 0.5 * SenseFit::kLapse) / (1 - SenseFit::kLapse);
  return std::log(share / (1 - share));
}

}  // namespace

std::optional<SenseFit> fit_sense(std::span<const SenseAnswer> answers) {
  if (answers.size() < SenseFit::kLeastAnswers) return std::nullopt;
  double smallest = std::abs(answers.front().difference), largest = smallest;
  for (const SenseAnswer& one : answers) {
    smallest = std::min(smallest, std::abs(one.difference));
    largest = std::max(largest, std::abs(one.difference));
  }
  if (!(largest > 0)) return std::nullopt;
  smallest = std::max(smallest, 1e-3 * largest);
  // The likelihood has one maximum over a wide range, so a grid that shrinks around its best point finds it.
  const double least = std::log(0.1 * smallest / threshold_of_spread()),
               most = std::log(5 * largest / threshold_of_spread());
  double spread = 0.5 * (least + most), bias = 0, of_spread = 0.5 * (most - least), of_bias = largest;
  constexpr int kSteps = 10, kRounds = 12;  // points to each side; each round is half as wide
  for (int round = 0; round < kRounds; ++round) {
    double best = -HUGE_VAL, best_spread = spread, best_bias = bias;
    for (int i = -kSteps; i <= kSteps; ++i)
      for (int j = -kSteps; j <= kSteps; ++j) {
        const double s = std::clamp(spread + of_spread * i / kSteps, least, most), b = bias + of_bias * j / kSteps;
        if (const double value = log_likelihood(answers, b, std::exp(s)); value > best) {
          best = value;
          best_spread = s;
          best_bias = b;
        }
      }
    spread = best_spread;
    bias = best_bias;
    of_spread *= 0.5;
    of_bias *= 0.5;
  }
  constexpr double kAtEnd = 0.01;
  if (spread < least + kAtEnd || spread > most - kAtEnd || std::abs(bias) > largest) return std::nullopt;
  // Where twice the logarithm falls by the 95 % point of the chi-square distribution with one degree of freedom.
  constexpr double kFall = 0.5 * 3.841459;
  const double top = log_likelihood(answers, bias, std::exp(spread));
  const auto falls_at = [&](double s) {
    double best = -HUGE_VAL;
    for (int j = -2 * kSteps; j <= 2 * kSteps; ++j)
      best = std::max(best, log_likelihood(answers, bias + 0.25 * largest * j / kSteps, std::exp(s)));
    return top - best > kFall;
  };
  const auto end_towards = [&](double end) {
    double inside = spread, outside = end;
    if (!falls_at(end)) return end;
    for (int i = 0; i < kRounds; ++i) {
      const double middle = 0.5 * (inside + outside);
      (falls_at(middle) ? outside : inside) = middle;
    }
    return outside;
  };
  return SenseFit{.threshold = threshold_of_spread() * std::exp(spread),
                  .low = threshold_of_spread() * std::exp(end_towards(least)),
                  .high = threshold_of_spread() * std::exp(end_towards(most)),
                  .bias = bias,
                  .slope = 0.25 * (1 - SenseFit::kLapse) / std::exp(spread)};
}

std::optional<SenseSummary> summarise_sense(const Programme& programme, std::size_t i, const SessionLog& log) {
  if (!programme.exercise(i).sense) return std::nullopt;
  SenseSummary summary;
  std::vector<SenseAnswer> answers;
  for (const LoggedTrial& trial : log.trials) {
    if (trial.exercise != i || !trial.sense || !trial.done() || !trial.input.empty() || trial.unattended) continue;
    if (trial.figures.is_object() && trial.figures.contains("refused")) {
      ++summary.refused;
      continue;
    }
    const std::optional<double> difference = figure_in(trial.figures, "sense_difference_m");
    if (trial.sense->answer == 0 || !difference) {
      ++summary.unanswered;
      continue;
    }
    answers.push_back({.difference = *difference, .second = trial.sense->answer == 2});
    if (answers.back().second == (*difference > 0)) ++summary.right;
  }
  summary.answers = answers.size();
  summary.fit = fit_sense(answers);
  return summary;
}

nlohmann::json to_json(const SenseSummary& summary) {
  const auto of_fit = [&](double SenseFit::*member) {
    return summary.fit ? json_of_number((*summary.fit).*member) : nlohmann::json(nullptr);
  };
  return {{"goal", "sense"},
          {"answers", summary.answers},
          {"right", summary.right},
          {"unanswered", summary.unanswered},
          {"refused", summary.refused},
          {"threshold_m", of_fit(&SenseFit::threshold)},
          {"threshold_low_m", of_fit(&SenseFit::low)},
          {"threshold_high_m", of_fit(&SenseFit::high)},
          {"bias_m", of_fit(&SenseFit::bias)},
          {"slope_per_m", of_fit(&SenseFit::slope)}};
}

std::vector<NamedResult> results_of(const SenseSummary& summary) {
  NamedResult answers{"answers", fmt::format("{}", summary.answers)};
  if (!summary.fit) return {{"threshold", "undefined"}, {"bias", "undefined"}, std::move(answers)};
  const SenseFit& fit = *summary.fit;
  return {{"threshold", fmt::format("{:.1f} mm (95 % interval {:.1f} to {:.1f} mm)", 1e3 * fit.threshold, 1e3 * fit.low,
                                    1e3 * fit.high)},
          {"bias", fmt::format("{:.1f} mm", 1e3 * fit.bias)},
          std::move(answers)};
}

std::string describe(const SenseSummary& summary) {
  // Few answers would tell those who gave them which were right.
  const bool enough = summary.answers >= SenseFit::kLeastAnswers;
  const double right =
      summary.answers > 0 ? 100.0 * static_cast<double>(summary.right) / static_cast<double>(summary.answers) : 0;
  std::string text = fmt::format("{} answer{}", summary.answers, summary.answers == 1 ? "" : "s");
  if (enough) text += fmt::format(", {:.0f} % right", right);
  if (summary.unanswered > 0) text += fmt::format(", {} without an answer", summary.unanswered);
  if (summary.refused > 0)
    text += fmt::format(", {} left out, in which the hand did not let the device lead it", summary.refused);
  if (summary.fit) {
    const std::vector<NamedResult> results = results_of(summary);
    return text + fmt::format(": {} {}, {} {}", results[0].name, results[0].value, results[1].name, results[1].value);
  }
  if (!enough) return text + fmt::format(": no threshold from fewer than {} answers", SenseFit::kLeastAnswers);
  constexpr double kTold = 70, kOther = 40;  // [%]
  return text +
         (right > kTold
              ? ": no threshold in the range of the differences, because nearly all answers were right or a bias hides "
                "it; choose smaller differences as well"
          : right < kOther ? ": the answers are the other way round; check that the question is understood"
                           : ": the threshold is above the differences, or the answers are by chance");
}

}  // namespace haptrace
