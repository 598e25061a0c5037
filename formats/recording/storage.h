// How the values of a recording lie on the disk: as they are, packed, or rounded to what is asked for.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace haptrace {

/// The largest error that a stored value may have, by quantity; 0 keeps every bit. SI.
struct Precision {
  double position = 0;  ///< [m]
  double velocity = 0;  ///< [m/s]
  double force = 0;     ///< [N]
  double torque = 0;    ///< [N m]

  [[nodiscard]] bool lossless() const noexcept { return position == 0 && velocity == 0 && force == 0 && torque == 0; }
  bool operator==(const Precision&) const = default;
};

/// Reads "1um,1mN": a positive number, a prefix (n, u or µ, m or none) and a unit (m, m/s, N, Nm) for every quantity
/// that may be rounded. Empty: none. Throws Error(input) naming the part.
Precision parse_precision(std::string_view text);

/// The inverse, for people and configurations.
std::string to_string(const Precision& precision);

/// Storage of a recording. HDF5's own filters, so that any HDF5 program reads it.
struct Storage {
  /// 0: as it lies in memory; 1 to 9: shuffle and deflate.
  int deflate = 0;

  /// Rounds with HDF5's scale-offset filter, to the coarsest decimal step that keeps the bound. Values that the filter
  /// cannot hold within it (not finite, or too far apart) are stored as they are.
  Precision precision;

  /// Rows that are written at once; 0: chosen by how they are stored. Chunks that are stored as they lie in memory cost
  /// less the larger they are, and a flush in between adds to the last one; chunks with a filter are written when they
  /// are full, so that up to this many rows are lost with the process.
  std::size_t rows_per_chunk = 0;

  [[nodiscard]] bool filtered() const noexcept { return deflate > 0 || !precision.lossless(); }
};

/// Throws Error(input) unless the level is 0 to 9 and every bound finite and not negative.
void validate(const Storage& storage);

}  // namespace haptrace
