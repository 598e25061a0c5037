#include "formats/volume/value_source.h"

#include "base/error.h"
#include "base/text_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <memory>
#include <unistd.h>
#include <zlib.h>

namespace haptrace {
namespace {

constexpr std::size_t kChunk = std::size_t{1} << 18U;  // values at a time
constexpr std::uint64_t kGzipRatio = 1032;             // deflate compresses at most so much

std::string failure() {
  return std::strerror(errno);
}

/// Bytes of a file from an offset on, decompressed if they are compressed.
class Bytes {
 public:
  explicit Bytes(const ValueSource& source) : file_(source.file) {
    const int descriptor = open(file_.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) throw input_error(fmt::format("{}: cannot be read: {}", file_, failure()));
    if (lseek(descriptor, static_cast<off_t>(source.begin), SEEK_SET) < 0) {
      const std::string why = failure();
      (void)close(descriptor);
      throw input_error(fmt::format("{}: cannot be read from byte {}: {}", file_, source.begin, why));
    }
    if (source.encoding == ValueSource::Encoding::gzip) {
      zipped_.reset(gzdopen(descriptor, "rb"));
      if (!zipped_) (void)close(descriptor);
    } else {
      plain_.reset(fdopen(descriptor, "rb"));
      if (!plain_) (void)close(descriptor);
    }
    if (!zipped_ && !plain_) throw input_error(fmt::format("{}: cannot be read: {}", file_, failure()));
    if (zipped_ && gzdirect(zipped_.get()) != 0)
      throw input_error(fmt::format("{}: from byte {} on, the values are not compressed by gzip", file_, source.begin));
  }

  /// Returns the number of bytes read, less than `count` only at the end.
  std::size_t read(void* into, std::size_t count) {
    if (plain_) return std::fread(into, 1, count, plain_.get());
    std::size_t done = 0;
    while (done < count) {
      const int got = gzread(zipped_.get(), static_cast<char*>(into) + done,
                             static_cast<unsigned>(std::min<std::size_t>(count - done, 1U << 30U)));
      if (got < 0) throw damaged();
      if (got == 0) break;
      done += static_cast<std::size_t>(got);
    }
    return done;
  }

  /// Checks what follows the values: the sum at the end of compressed ones. Returns whether there are more bytes.
  bool finish() {
    char more = 0;
    if (!zipped_) return read(&more, 1) > 0;
    int code = Z_OK;
    const int got = gzread(zipped_.get(), &more, 1);
    if (got < 0) throw damaged();
    (void)gzerror(zipped_.get(), &code);
    if (code != Z_OK) throw damaged();
    return got > 0;
  }

 private:
  struct CloseZipped {
    void operator()(gzFile file) const noexcept { (void)gzclose(file); }
  };

  [[nodiscard]] Error damaged() const {
    int code = Z_OK;
    const char* const text = gzerror(zipped_.get(), &code);
    return input_error(fmt::format("{}: the compressed values are damaged: {}", file_, shown(text)));
  }

  std::string file_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> plain_{nullptr, std::fclose};
  std::unique_ptr<gzFile_s, CloseZipped> zipped_;
};

Error ends_early(const ValueSource& source, std::size_t read, std::size_t count) {
  return input_error(fmt::format("{}: ends after {} of {} values; is it complete?", source.file, read, count));
}

/// Adds one value. Throws if it is not finite.
void add(const ValueSource& source, double number, std::vector<float>& values) {
  const double value = source.slope * number + source.intercept;
  const auto stored = static_cast<float>(value);
  if (!std::isfinite(stored))
    throw input_error(
        fmt::format("{}: value {} (from 0) is {}; replace values that are not finite numbers of single "
                    "precision",
                    source.file, values.size(), value));
  values.push_back(stored);
}

template <class Number>
void decode(const ValueSource& source, const char* bytes, std::size_t count, std::vector<float>& values) {
  const bool swapped = source.big_endian != (std::endian::native == std::endian::big);
  for (std::size_t i = 0; i < count; ++i, bytes += sizeof(Number)) {
    std::array<char, sizeof(Number)> own{};
    std::copy_n(bytes, sizeof(Number), own.begin());
    if (swapped) std::reverse(own.begin(), own.end());
    Number number{};
    std::memcpy(&number, own.data(), sizeof number);
    add(source, static_cast<double>(number), values);
  }
}

using Decode = void (*)(const ValueSource&, const char*, std::size_t, std::vector<float>&);

struct TypeRow {
  std::size_t bytes;
  Decode decode;
};

const TypeRow& row_of(ValueType type) noexcept {
  static constexpr std::array kRows{TypeRow{1, decode<std::int8_t>},  TypeRow{1, decode<std::uint8_t>},
                                    TypeRow{2, decode<std::int16_t>}, TypeRow{2, decode<std::uint16_t>},
                                    TypeRow{4, decode<std::int32_t>}, TypeRow{4, decode<std::uint32_t>},
                                    TypeRow{4, decode<float>},        TypeRow{8, decode<double>}};
  return kRows[static_cast<std::size_t>(type)];
}

/// Returns whether the text continues after the values.
bool read_text(const ValueSource& source, std::size_t count, std::vector<float>& values) {
  Bytes bytes(source);
  std::vector<char> buffer(1U << 16U);
  std::string word;
  const auto take = [&] {
    double number = 0;
    if (!parse_number(word, number))
      throw input_error(
          fmt::format("{}: value {} (from 0) is '{}', which is not a number", source.file, values.size(), shown(word)));
    add(source, number, values);
    word.clear();
  };
  for (;;) {
    const std::size_t got = bytes.read(buffer.data(), buffer.size());
    if (got == 0) break;
    for (std::size_t i = 0; i < got; ++i) {
      const char c = buffer[i];
      const bool blank = c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == ',';
      if (!blank && values.size() == count) return true;
      if (!blank) word += c;
      if ((blank && !word.empty()) || word.size() > 100) take();
    }
  }
  if (!word.empty() && values.size() < count) take();
  return false;
}

}  // namespace

std::size_t bytes_of(ValueType type) noexcept {
  return row_of(type).bytes;
}

VolumeValues read_values(const ValueSource& source, std::size_t count) {
  namespace fs = std::filesystem;
  using Encoding = ValueSource::Encoding;
  std::error_code error;
  if (!fs::is_regular_file(source.file, error)) throw input_error(source.file + ": no such file");
  const std::uint64_t size = fs::file_size(source.file, error), rest = size - std::min(size, source.begin);
  const TypeRow& row = row_of(source.type);
  // A header may state any number of values.
  const bool fits = source.encoding == Encoding::text ? 2 * count - 1 <= rest
                    : source.encoding == Encoding::gzip
                        ? (count * row.bytes + source.skip) / kGzipRatio <= rest
                        : source.skip <= rest && count * row.bytes <= rest - source.skip;
  if (!fits)
    throw input_error(fmt::format("{}: has {} bytes from byte {} on, too few for {} values; is it complete?",
                                  source.file, rest, source.begin, count));
  VolumeValues read;
  std::vector<float>& values = read.numbers;
  values.reserve(count);
  if (source.encoding == Encoding::text) {
    read.more = read_text(source, count, values);
  } else {
    Bytes bytes(source);
    std::vector<char> buffer(std::min(count, kChunk) * row.bytes);
    for (std::uint64_t skipped = 0; skipped < source.skip;) {
      const std::size_t got = bytes.read(buffer.data(), std::min<std::uint64_t>(source.skip - skipped, buffer.size()));
      if (got == 0) throw ends_early(source, 0, count);
      skipped += got;
    }
    while (values.size() < count) {
      const std::size_t wanted = std::min(count - values.size(), kChunk);
      const std::size_t got = bytes.read(buffer.data(), wanted * row.bytes) / row.bytes;
      row.decode(source, buffer.data(), got, values);
      if (got < wanted) break;
    }
    if (values.size() == count) read.more = bytes.finish();
  }
  if (values.size() < count) throw ends_early(source, values.size(), count);
  return read;
}

}  // namespace haptrace
