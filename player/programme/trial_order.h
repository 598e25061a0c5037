// Random orders of the repetitions of a programme, the same on every platform.
#pragma once

#include "formats/documents/programme.h"

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

namespace haptrace {

/// Draws numbers and orders from a seed.
///
/// std::mt19937_64 is defined to the bit by the standard, but the distributions and std::shuffle of the standard
/// libraries differ. below() therefore rejects the draws beyond the largest multiple of its range, and shuffle() is
/// Fisher and Yates's, from the end (Knuth, The Art of Computer Programming, vol. 2, algorithm P).
class OrderDraw {
 public:
  static constexpr const char* kName = "mt19937_64, Fisher-Yates, version 1";  ///< for logs

  explicit OrderDraw(std::uint64_t seed) : random_(seed) {}

  /// Returns a number from 0 to `count` - 1, all equally likely. `count` must not be 0.
  [[nodiscard]] std::uint64_t below(std::uint64_t count);

  template <class Value>
  void shuffle(std::vector<Value>& values) {
    for (std::size_t i = values.size(); i > 1; --i) std::swap(values[i - 1], values[below(i)]);
  }

 private:
  std::mt19937_64 random_;
};

/// One repetition in the order of its round.
struct OrderedTrial {
  std::size_t exercise = 0;  ///< see Programme::exercise
  int repetition = 1;

  bool operator==(const OrderedTrial&) const = default;
};

/// Returns the repetitions of one round, without the warm-up, in the order that the programme asks for:
/// - listed: exercise by exercise, as in the file;
/// - blocked: exercise by exercise, the exercises in a random order;
/// - interleaved: cycles, each with one repetition of every exercise that has any left, in a random order. No exercise
///   follows itself while another one is left in the cycle.
///
/// Catch trials are not part of this order: they lie at random places between its repetitions. None is among the first
/// five of the round, and no two follow each other. Throws Error(input) naming the key if there are too many of them.
std::vector<OrderedTrial> order_of_round(const Programme& programme, OrderDraw& draw);

}  // namespace haptrace
