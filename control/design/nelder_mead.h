// Minimisation of a function of a few variables without derivatives.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

namespace haptrace {

/// Returns the best point that the simplex method of Nelder and Mead (1965, "A simplex method for function
/// minimization", Computer Journal 7(4)) finds with at most `evaluations` of `f`, more than Size of them. It reflects,
/// expands, contracts and shrinks by the factors 1, 2, 1/2 and 1/2 in the order of Lagarias, Reeds, Wright and Wright
/// (1998, SIAM J. Optim. 9(1)), from a simplex of `start` and one point `steps[i]` away from it along each variable.
/// Ends earlier when the values at the corners of the simplex differ by less than `spread`. `f` may have any finite
/// value. The result depends only on the values of `f`.
template <std::size_t Size, class Function>
std::array<double, Size> minimised(const Function& f, const std::array<double, Size>& start,
                                   const std::array<double, Size>& steps, int evaluations, double spread = 0) {
  using Point = std::array<double, Size>;
  struct Vertex {
    Point at{};
    double value = 0;
  };
  std::array<Vertex, Size + 1> simplex{};
  const auto evaluated = [&](const Point& at) {
    --evaluations;
    return Vertex{at, f(at)};
  };
  simplex[0] = evaluated(start);
  for (std::size_t i = 0; i < Size; ++i) {
    Point next = start;
    next[i] += steps[i];
    simplex[i + 1] = evaluated(next);
  }
  const auto sort = [&] {
    std::stable_sort(simplex.begin(), simplex.end(),
                     [](const Vertex& a, const Vertex& b) { return a.value < b.value; });
  };
  sort();
  while (evaluations > 0 && !(simplex.back().value - simplex.front().value < spread)) {
    Vertex& worst = simplex.back();
    const Vertex &best = simplex.front(), &second_worst = simplex[Size - 1];
    // Returns the point at `factor` times the way from the centre of the others to the worst.
    const auto along = [&](double factor) {
      Point at{};
      for (std::size_t i = 0; i < Size; ++i) {
        double centre = 0;
        for (std::size_t v = 0; v < Size; ++v) centre += simplex[v].at[i] / static_cast<double>(Size);
        at[i] = centre + factor * (worst.at[i] - centre);
      }
      return evaluated(at);
    };
    const Vertex reflected = along(-1);
    if (reflected.value < best.value) {
      const Vertex expanded = along(-2);
      worst = expanded.value < reflected.value ? expanded : reflected;
    } else if (reflected.value < second_worst.value) {
      worst = reflected;
    } else {
      const bool outside = reflected.value < worst.value;
      const Vertex contracted = along(outside ? -0.5 : 0.5);
      if (contracted.value < (outside ? reflected : worst).value) {
        worst = contracted;
      } else {
        for (std::size_t v = 1; v <= Size; ++v) {
          Point at{};
          for (std::size_t i = 0; i < Size; ++i) at[i] = 0.5 * (best.at[i] + simplex[v].at[i]);
          simplex[v] = evaluated(at);
        }
      }
    }
    sort();
  }
  return simplex.front().at;
}

}  // namespace haptrace
