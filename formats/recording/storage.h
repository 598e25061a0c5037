// Storage of the values of a recording: as they are, compressed, or rounded to a requested precision.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace haptrace {

/// Largest error of a stored value, by quantity, in SI units; 0 keeps every bit.
struct Precision {
  double position = 0;  ///< [m]
  double velocity = 0;  ///< [m/s]
  double force = 0;     ///< [N]
  double torque = 0;    ///< [N m]

  [[nodiscard]] bool lossless() const noexcept { return position == 0 && velocity == 0 && force == 0 && torque == 0; }
  bool operator==(const Precision&) const = default;
};

/// Parses "1um,1mN": a positive number, a prefix (n, u or µ, m or none) and a unit (m, m/s, N, Nm) for every quantity
/// that may be rounded; or a unit of parse_quantity(), as in "2 microns". Empty: no rounding. Throws Error(input)
/// naming the part.
Precision parse_precision(std::string_view text);

/// Formats a precision for users and configurations, so that parse_precision() can read it.
std::string to_string(const Precision& precision);

/// Storage of a recording. It uses HDF5's own filters, so that any HDF5 program can read the file.
struct Storage {
  /// Compression. 0: none; 1 to 9: level of deflate, after shuffle where that helps.
  int deflate = 0;

  /// Rounds with HDF5's scale-offset filter, to the coarsest decimal step that keeps the bound. Values that the filter
  /// cannot hold within the bound (not finite, or too far apart) are stored as they are.
  Precision precision;

  /// Rows per chunk; 0: chosen by the other settings. Unfiltered chunks cost less the larger they are, and a flush in
  /// between extends the last one. Filtered chunks are written when they are full, so up to this many rows are lost if
  /// the process dies.
  std::size_t rows_per_chunk = 0;

  [[nodiscard]] bool filtered() const noexcept { return deflate > 0 || !precision.lossless(); }
};

/// Throws Error(input) unless the level is 0 to 9 and every bound is finite and not negative.
void validate(const Storage& storage);

}  // namespace haptrace
