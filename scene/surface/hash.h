// Random numbers that depend on a place alone.
#pragma once

#include "base/types.h"

#include <array>
#include <cmath>
#include <cstdint>

namespace haptrace {

/// Mixes the bits of a number (finaliser of splitmix64, Steele, Lea and Flood 2014). Real-time.
constexpr std::uint64_t mixed(std::uint64_t x) noexcept {
  x += 0x9e3779b97f4a7c15;
  x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9;
  x = (x ^ (x >> 27U)) * 0x94d049bb133111eb;
  return x ^ (x >> 31U);
}

/// A cell of a cubic lattice.
using LatticeCell = std::array<std::int64_t, 3>;

/// Returns the cell that holds a place, in units of the cell's edge. Places beyond 2^52 share the outermost cells.
inline LatticeCell cell_of(const Vec3& place) noexcept {
  constexpr double kMost = 4.5e15;
  const Vec3 floored = place.array().floor().max(-kMost).min(kMost);
  return {static_cast<std::int64_t>(floored.x()), static_cast<std::int64_t>(floored.y()),
          static_cast<std::int64_t>(floored.z())};
}

/// Returns random bits for a cell.
constexpr std::uint64_t hash_of_cell(const LatticeCell& cell, std::uint64_t seed) noexcept {
  std::uint64_t bits = mixed(seed);
  for (const std::int64_t part : cell) bits = mixed(bits ^ static_cast<std::uint64_t>(part));
  return bits;
}

/// Returns a number from 0 to below 1, from random bits.
constexpr double unit_number(std::uint64_t bits) noexcept {
  return static_cast<double>(bits >> 11U) * 0x1p-53;
}

}  // namespace haptrace
