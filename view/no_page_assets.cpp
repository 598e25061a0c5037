#include "view/page_assets.h"

namespace haptrace {

std::span<const PageAsset> page_assets() noexcept {
  return {};
}

}  // namespace haptrace
