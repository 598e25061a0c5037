// A recording as JSON lines.
#include "formats/recording_formats.h"
#include "tests/fuzz/fuzz.h"

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string file = fuzz::file_of(fuzz::text_of(data, size));
  for (const bool any_order : {false, true})
    fuzz::answer([&] {
      const auto source = open_jsonl(file, {.any_order = any_order});
      std::optional<std::int64_t> before;
      for (auto block = source->next(); !block.empty(); block = source->next())
        if (!any_order) check_order(block, before, file);
      fuzz::require(source->fraction() >= 0 && source->fraction() <= 1);
      (void)source->events();
      (void)source->notes();
    });
  return 0;
}
