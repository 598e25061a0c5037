#include "player/programme/trial_order.h"

#include "base/error.h"

#include <algorithm>
#include <fmt/format.h>
#include <numeric>

namespace haptrace {
namespace {

constexpr std::size_t kBeforeCatch = 5;  // repetitions before the first catch trial of a round

using Order = std::vector<OrderedTrial>;

void append_all(const Programme& programme, std::size_t exercise, Order& order) {
  for (int repetition = 1; repetition <= programme.exercise(exercise).repetitions; ++repetition)
    order.push_back({exercise, repetition});
}

Order interleaved(const Programme& programme, const std::vector<std::size_t>& exercises, OrderDraw& draw) {
  int cycles = 0;
  for (const std::size_t i : exercises) cycles = std::max(cycles, programme.exercise(i).repetitions);
  Order order;
  for (int cycle = 1; cycle <= cycles; ++cycle) {
    std::vector<std::size_t> left;
    std::copy_if(exercises.begin(), exercises.end(), std::back_inserter(left),
                 [&](std::size_t i) { return programme.exercise(i).repetitions >= cycle; });
    do {
      draw.shuffle(left);
    } while (left.size() > 1 && !order.empty() && left.front() == order.back().exercise);
    for (const std::size_t i : left) order.push_back({i, cycle});
  }
  return order;
}

/// Puts the catch trials between the others.
Order with_catch_trials(const Order& others, Order catches, OrderDraw& draw) {
  if (catches.empty()) return others;
  std::vector<std::size_t> gaps(others.size() < kBeforeCatch ? 0 : others.size() + 1 - kBeforeCatch);
  std::iota(gaps.begin(), gaps.end(), kBeforeCatch);  // numbers of repetitions that come before the gap
  if (catches.size() > gaps.size())
    throw input_error(
        fmt::format("exercises: {} catch trials have no room among {} repetitions of a round: none is among the first "
                    "{}, and no two follow each other. Lower their repetitions",
                    catches.size(), others.size(), kBeforeCatch));
  draw.shuffle(catches);
  draw.shuffle(gaps);
  gaps.resize(catches.size());
  std::sort(gaps.begin(), gaps.end());
  Order order;
  for (std::size_t i = 0, next = 0; i <= others.size(); ++i) {
    if (next < gaps.size() && gaps[next] == i) order.push_back(catches[next++]);
    if (i < others.size()) order.push_back(others[i]);
  }
  return order;
}

}  // namespace

std::uint64_t OrderDraw::below(std::uint64_t count) {
  const std::uint64_t rest = (0 - count) % count;  // 2^64 modulo count
  std::uint64_t drawn = random_();
  while (drawn < rest) drawn = random_();
  return drawn % count;
}

std::vector<OrderedTrial> order_of_round(const Programme& programme, OrderDraw& draw) {
  std::vector<std::size_t> exercises;
  Order catches, order;
  for (std::size_t i = programme.warm_up.size(); i < programme.size(); ++i)
    if (programme.exercise(i).catch_trial)
      append_all(programme, i, catches);
    else
      exercises.push_back(i);
  if (programme.order == TrialOrder::interleaved) {
    order = interleaved(programme, exercises, draw);
  } else {
    if (programme.order == TrialOrder::blocked) draw.shuffle(exercises);
    for (const std::size_t i : exercises) append_all(programme, i, order);
  }
  return with_catch_trials(order, std::move(catches), draw);
}

}  // namespace haptrace
