#include "view/gzip.h"

#include <array>
#include <stdexcept>
#include <zlib.h>

namespace haptrace {

std::string gunzip(std::string_view compressed) {
  constexpr int kGzip = 15 + 16;  // window, and the format
  z_stream stream{};
  if (inflateInit2(&stream, kGzip) != Z_OK) throw std::runtime_error("zlib cannot start");
  // zlib reads through a pointer to non-constant data.
  std::string input(compressed), output;
  stream.next_in = reinterpret_cast<Bytef*>(input.data());
  stream.avail_in = static_cast<uInt>(input.size());
  std::array<char, 16384> chunk{};
  int result = Z_OK;
  while (result == Z_OK) {
    stream.next_out = reinterpret_cast<Bytef*>(chunk.data());
    stream.avail_out = static_cast<uInt>(chunk.size());
    result = inflate(&stream, Z_NO_FLUSH);
    output.append(chunk.data(), chunk.size() - stream.avail_out);
  }
  inflateEnd(&stream);
  if (result != Z_STREAM_END) throw std::runtime_error("the compressed data are damaged");
  return output;
}

}  // namespace haptrace
