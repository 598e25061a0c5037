// Position sense from forced choices: the difference that a participant tells in three of four cases.
#pragma once

#include "formats/documents/session_log.h"
#include "metrics/named_result.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// One answer.
struct SenseAnswer {
  double difference = 0;  ///< distance of the second place less that of the first one, as the hand was moved [m]
  bool second = false;    ///< the participant said that the second one was farther
};

/// A psychometric function
///
///     P(second) = l / 2 + (1 - l) / (1 + exp(-(d - bias) / s)),   l = kLapse,
///
/// fitted by maximum likelihood. Two intervals make chance one half; lapses are answers without attention (Wichmann and
/// Hill, Perception & Psychophysics 63(8), 2001).
struct SenseFit {
  double threshold = 0;      ///< difference that is told in 75 % of the cases, without a bias: 1.126 s [m]
  double low = 0, high = 0;  ///< its 95 % confidence interval, from the profile of the likelihood [m]
  double bias = 0;   ///< difference at which both answers are as likely: what is remembered shrinks or grows [m]
  double slope = 0;  ///< dP / dd at the bias [1/m]

  static constexpr double kLapse = 0.02;
  static constexpr std::size_t kLeastAnswers = 20;
};

/// Returns the fit; nothing for fewer than kLeastAnswers, and for answers that have no threshold between a tenth of the
/// smallest and five times the largest difference: all right, or by chance.
std::optional<SenseFit> fit_sense(std::span<const SenseAnswer> answers);

/// Results of an exercise in mode sense. Trials of a simulated hand that a person steered, and those that were softened
/// because nobody attended, do not count.
struct SenseSummary {
  std::size_t answers = 0, right = 0;
  std::size_t unanswered = 0;
  std::size_t refused = 0;  ///< the hand did not let the device lead it
  std::optional<SenseFit> fit;
};

/// Returns the results of exercise `i`; nothing if it is in another mode.
std::optional<SenseSummary> summarise_sense(const Programme& programme, std::size_t i, const SessionLog& log);

nlohmann::json to_json(const SenseSummary& summary);

/// Returns threshold, bias and the number of answers.
std::vector<NamedResult> results_of(const SenseSummary& summary);

/// Returns one line for users: "120 answers, 78 % right: threshold 4.1 mm, bias 0.3 mm".
std::string describe(const SenseSummary& summary);

}  // namespace haptrace
