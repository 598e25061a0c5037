// Fuzz target: a volume in a file. The first byte names the format; a file of raw values lies beside it.
#include "formats/volume/volume_file.h"
#include "tests/fuzz/fuzz.h"

#include <array>
#include <cmath>

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::array kEndings{"nrrd", "nhdr", "nii", "nii.gz", "json"};
  if (size == 0) return 0;
  static const test::TempFolder folder;
  (void)folder.write("input.raw", std::string(256, '\1'));
  const std::string name = std::string("input.") + kEndings.at(data[0] % kEndings.size());
  const std::string file = folder.write(name, fuzz::text_of(data + 1, size - 1));
  fuzz::answer([&] {
    const VolumeData volume = load_volume(file, "").data;
    std::size_t count = 1;
    for (const std::size_t samples : volume.size) {
      fuzz::require(samples >= 2);
      count *= samples;
    }
    fuzz::require(count <= kMostVoxels && volume.values.size() == count);
    for (const float value : volume.values) fuzz::require(std::isfinite(value));
    fuzz::require(is_finite(volume.origin) && volume.steps.allFinite() && volume.steps.determinant() != 0);
  });
  return 0;
}
