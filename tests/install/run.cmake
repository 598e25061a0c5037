# Installs the build into a folder of its own, then configures, builds and runs the consumer against it.
#   cmake -DBUILD=... -DSOURCE=... -DOUT=... -DGENERATOR=... -DCOMPILER=... -DFLAGS=... -P run.cmake
function(step)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE failed OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(failed)
    message(FATAL_ERROR "${ARGV}\n${output}")
  endif()
endfunction()

file(REMOVE_RECURSE ${OUT})
step(${CMAKE_COMMAND} --install ${BUILD} --prefix ${OUT}/prefix)
step(${CMAKE_COMMAND} -E compare_files ${SOURCE}/../../devices/udev/70-haptrace.rules
     ${OUT}/prefix/lib/udev/rules.d/70-haptrace.rules)
step(${CMAKE_COMMAND} -S ${SOURCE}/consumer -B ${OUT}/build -DCMAKE_PREFIX_PATH=${OUT}/prefix
     -G ${GENERATOR} -DCMAKE_CXX_COMPILER=${COMPILER} -DCMAKE_CXX_FLAGS=${FLAGS})
step(${CMAKE_COMMAND} --build ${OUT}/build)
step(${OUT}/build/consumer ${OUT}/recorded.h5)
step(${OUT}/prefix/bin/haptrace check ${OUT}/recorded.h5)
