// Fuzz target: a programme as JSON. Every valid programme has exercises with a path to follow.
#include "formats/documents/programme.h"

#include "base/json_reader.h"
#include "tests/fuzz/fuzz.h"

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::answer([&] {
    const Programme programme =
        programme_from_json(parse_json(std::string(fuzz::text_of(data, size)), "input"), "input");
    fuzz::require(!programme.exercises.empty());
    for (std::size_t i = 0; i < programme.size(); ++i)
      if (const Exercise& exercise = programme.exercise(i); exercise.shape)
        fuzz::require(path_of(programme, exercise, ".").size() > 0);
  });
  return 0;
}
