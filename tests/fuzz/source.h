// Checks the promises of every reader of recordings.
#pragma once

#include "formats/recording/recording_formats.h"
#include "tests/fuzz/fuzz.h"

namespace haptrace::fuzz {

/// Reads a file of this content to its end with `open(file, any_order)`, once for each value of `any_order`.
template <class Open>
void read_to_end(const std::uint8_t* data, std::size_t size, const Open& open) {
  const std::string file = file_of(text_of(data, size));
  for (const bool any_order : {false, true})
    answer([&] {
      const auto source = open(file, any_order);
      std::optional<Sample> before;
      for (auto block = source->next(); !block.empty(); block = source->next())
        if (!any_order) check_order(block, before, file);
      require(source->fraction() >= 0 && source->fraction() <= 1);
      (void)source->events();
      (void)source->notes();
    });
}

}  // namespace haptrace::fuzz
