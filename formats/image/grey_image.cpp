#include "formats/image/grey_image.h"

#include "base/error.h"

#include <array>
#include <cctype>
#include <cerrno>
#include <csetjmp>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fmt/format.h>
#include <memory>
#include <png.h>
#include <string_view>

namespace haptrace {
namespace {

constexpr std::size_t kMostPixels = 64'000'000;

using Stream = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

void check_size(const std::string& file, std::uint64_t columns, std::uint64_t rows) {
  if (columns == 0 || rows == 0) throw input_error(file + ": the image has no pixels");
  if (columns > kMostPixels || rows > kMostPixels || columns * rows > kMostPixels)
    throw input_error(
        fmt::format("{}: the image has {} x {} pixels; the most is {}", file, columns, rows, kMostPixels));
}

/// An error that libpng reports through longjmp.
struct PngFailure {
  std::array<char, 200> text{};
};

void keep_failure(png_structp png, png_const_charp text) {
  auto* const failure = static_cast<PngFailure*>(png_get_error_ptr(png));
  std::snprintf(failure->text.data(), failure->text.size(), "%s", text);
  longjmp(png_jmpbuf(png), 1);  // NOLINT(cert-err52-cpp): the way of libpng
}

void ignore_warning(png_structp, png_const_charp) {}

/// Reads a PNG as 16-bit grey values. Nothing here has a destructor, because libpng leaves by longjmp. Returns false on
/// failure.
bool read_png(png_structp png, png_infop info, std::FILE* stream, std::uint32_t* columns, std::uint32_t* rows,
              std::uint16_t* pixels, png_bytep* lines) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;  // NOLINT: the way of libpng
  if (pixels == nullptr) {
    png_init_io(png, stream);
    png_set_user_limits(png, 1'000'000, 1'000'000);
    png_read_info(png, info);
    *columns = png_get_image_width(png, info);
    *rows = png_get_image_height(png, info);
    png_set_expand_16(png);
    png_set_strip_alpha(png);
    if ((png_get_color_type(png, info) & PNG_COLOR_MASK_COLOR) != 0 ||
        png_get_color_type(png, info) == PNG_COLOR_TYPE_PALETTE)
      png_set_rgb_to_gray(png, PNG_ERROR_ACTION_NONE, PNG_RGB_TO_GRAY_DEFAULT, PNG_RGB_TO_GRAY_DEFAULT);
    png_set_swap(png);  // to the order of this machine
    png_set_interlace_handling(png);
    png_read_update_info(png, info);
    return true;
  }
  for (std::uint32_t row = 0; row < *rows; ++row)
    lines[row] = reinterpret_cast<png_bytep>(pixels + static_cast<std::size_t>(row) * *columns);
  png_read_image(png, lines);
  return true;
}

GreyImage load_png(const std::string& file, std::FILE* stream) {
  PngFailure failure;
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &failure, keep_failure, ignore_warning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  struct Release {
    png_structp* png;
    png_infop* info;
    ~Release() { png_destroy_read_struct(png, info, nullptr); }
  } release{&png, &info};
  if (info == nullptr) throw input_error(file + ": there is no memory to read it");
  std::uint32_t columns = 0, rows = 0;
  const auto failed = [&] { return input_error(fmt::format("{}: is no valid PNG: {}", file, failure.text.data())); };
  if (!read_png(png, info, stream, &columns, &rows, nullptr, nullptr)) throw failed();
  check_size(file, columns, rows);
  if (png_get_rowbytes(png, info) != 2 * static_cast<std::size_t>(columns))
    throw input_error(file + ": the PNG could not be turned into 16-bit grey values");
  std::vector<std::uint16_t> pixels(static_cast<std::size_t>(columns) * rows);
  std::vector<png_bytep> lines(rows);
  if (!read_png(png, info, stream, &columns, &rows, pixels.data(), lines.data())) throw failed();
  GreyImage image{static_cast<int>(columns), static_cast<int>(rows), {}};
  image.values.reserve(pixels.size());
  for (const std::uint16_t pixel : pixels) image.values.push_back(static_cast<float>(pixel) / 65535.0F);
  return image;
}

/// Reads the next whole number of a PGM's text, past blanks and comments. Returns nothing at the end, or at other text.
bool next_number(std::FILE* stream, std::uint64_t& number) {
  int c = std::fgetc(stream);
  while (c == '#' || std::isspace(c) != 0) {
    if (c == '#')
      while (c != '\n' && c != EOF) c = std::fgetc(stream);
    c = std::fgetc(stream);
  }
  if (c < '0' || c > '9') return false;
  number = 0;
  for (; c >= '0' && c <= '9'; c = std::fgetc(stream))
    if ((number = 10 * number + static_cast<std::uint64_t>(c - '0')) > 1'000'000'000) return false;
  return true;  // the one blank after the number was taken
}

GreyImage load_pgm(const std::string& file, std::FILE* stream, bool text) {
  std::uint64_t columns = 0, rows = 0, white = 0;
  if (!next_number(stream, columns) || !next_number(stream, rows) || !next_number(stream, white))
    throw input_error(file + ": the header of the PGM does not state columns, rows and the largest value");
  check_size(file, columns, rows);
  if (white < 1 || white > 65535)
    throw input_error(fmt::format("{}: the largest value of the PGM is {}; it must be from 1 to 65535", file, white));
  GreyImage image{static_cast<int>(columns), static_cast<int>(rows), {}};
  const std::size_t count = columns * rows;
  const bool wide = white > 255;
  for (std::size_t i = 0; i < count; ++i) {
    std::uint64_t value = 0;
    if (text) {
      if (!next_number(stream, value))
        throw input_error(fmt::format("{}: pixel {} of {} is missing or is not a number", file, i, count));
    } else {
      const int high = wide ? std::fgetc(stream) : 0, low = std::fgetc(stream);
      if (high == EOF || low == EOF) throw input_error(fmt::format("{}: ends at pixel {} of {}", file, i, count));
      value = 256 * static_cast<std::uint64_t>(high) + static_cast<std::uint64_t>(low);
    }
    if (value > white)
      throw input_error(fmt::format("{}: pixel {} is {}, above the largest value {}", file, i, value, white));
    image.values.push_back(static_cast<float>(value) / static_cast<float>(white));
  }
  return image;
}

}  // namespace

GreyImage load_grey_image(const std::string& file) {
  const Stream stream(std::fopen(file.c_str(), "rb"), std::fclose);
  if (!stream) throw input_error(fmt::format("{}: cannot be read: {}", file, std::strerror(errno)));
  std::array<char, 8> head{};
  const std::string_view begin(head.data(), std::fread(head.data(), 1, head.size(), stream.get()));
  const bool text = begin.starts_with("P2");
  if (text || begin.starts_with("P5")) {
    std::fseek(stream.get(), 2, SEEK_SET);
    return load_pgm(file, stream.get(), text);
  }
  if (!begin.starts_with("\x89PNG")) throw input_error(file + ": is neither a PNG nor a PGM image");
  std::rewind(stream.get());
  return load_png(file, stream.get());
}

}  // namespace haptrace
