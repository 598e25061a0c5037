// The values of a volume in a file: numbers of any type, as bytes, compressed bytes or text. Internal to haptrace.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Types of numbers that a volume can have.
enum class ValueType : std::uint8_t { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

/// Returns the number of bytes of a value.
std::size_t bytes_of(ValueType type) noexcept;

/// Where and how the values of a volume are stored.
struct ValueSource {
  enum class Encoding : std::uint8_t { raw, gzip, text };

  std::string file;
  std::uint64_t begin = 0;  ///< offset of the encoded values in the file [bytes]
  Encoding encoding = Encoding::raw;
  std::uint64_t skip = 0;  ///< decoded bytes in front of the values
  ValueType type = ValueType::uint8;
  bool big_endian = false;
  double slope = 1, intercept = 0;  ///< a value is slope x number + intercept
};

struct VolumeValues {
  std::vector<float> numbers;
  bool more = false;  ///< the file has more than these
};

/// Reads values. Throws Error(input) naming the file and the place if there are fewer, if one is not finite, or if the
/// file is too small to hold them, before memory for them is allocated.
VolumeValues read_values(const ValueSource& source, std::size_t count);

}  // namespace haptrace
