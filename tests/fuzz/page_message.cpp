// Fuzz target: messages of a page of the live view, text or binary, and what a session answers to them.
#include "view/page_message.h"

#include "tests/fuzz/fuzz.h"
#include "view/frames.h"
#include "view/live_source.h"
#include "view/loopback_request.h"

#include <cmath>

using namespace haptrace;

namespace {

/// A session of 100 000 rows.
LiveSource& source() {
  static LiveSource session = [] {
    LiveSource filled{ViewedSession{}};
    Sample sample;
    for (std::int64_t row = 0; row < 100'000; ++row) {
      sample.time_ns = 1'000'000 * row;
      sample.position = Vec3::Constant(static_cast<double>(row));
      filled.add(sample);
    }
    return filled;
  }();
  return session;
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text = fuzz::text_of(data, size);
  if (const auto intention = parse_intention(text))
    fuzz::require(is_finite(intention->position) && intention->grip >= 0 && intention->grip <= 1);
  (void)accepts_gzip(text);
  fuzz::require(!is_loopback_host(text, 8080) || text.find("8080") != std::string_view::npos);

  const auto message = parse_page_message(text);
  if (!message) return 0;
  for (const double time : {message->t0, message->t1, message->time, message->sent})
    fuzz::require(std::isfinite(time) && std::abs(time) <= 1e10);
  if (message->type != PageMessage::Type::bins && message->type != PageMessage::Type::rows) return 0;
  const auto request = request_of(*message, source().channels());
  if (!std::holds_alternative<ViewRequest>(request)) return 0;
  int answers = 0;
  source().ask(std::get<ViewRequest>(request), [&](const Frame& frame) {
    ++answers;
    fuzz::require(frame.request == message->id);
    fuzz::require(frame.rows <= std::max<std::size_t>(kMostRows, kMostPixels + 2));
    if (frame.kind == FrameKind::bins)
      fuzz::require(frame.rows <= std::max<std::size_t>(message->pixels, 1) + 2);
    else
      fuzz::require(frame.body.size() == 4 * frame.rows * (source().channels().size() + 1));
  });
  fuzz::require(answers == 1);
  return 0;
}
