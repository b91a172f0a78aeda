# spgf_torch on the CPU: the wheel alone, without the checkout. Build and run:
#   docker build -t spgf_torch --build-arg TORCH_INDEX=INDEX .
#   docker run --rm --user $(id -u):$(id -g) -v $PWD:/work spgf_torch predict input=cloud.pcd table=find hand=panda
# INDEX: that of torch's builds for the CPU; without it pip may take one with gigabytes of CUDA.
ARG PYTHON=3.12

FROM python:${PYTHON}-slim AS build
WORKDIR /source
COPY . .
RUN pip install --no-cache-dir hatchling && hatchling build -t wheel -d /dist

FROM python:${PYTHON}-slim
# OpenGL, Vulkan and X11 are what SAPIEN and OpenCV link with; libgomp is torch's.
RUN apt-get update \
    && apt-get install -y --no-install-recommends libgl1 libglib2.0-0 libgomp1 libvulkan1 libx11-6 \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /dist/*.whl /tmp/
ARG TORCH_INDEX=""
RUN pip install --no-cache-dir ${TORCH_INDEX:+--index-url "${TORCH_INDEX}"} "torch>=2.6,<2.14" \
    && pip install --no-cache-dir "$(ls /tmp/*.whl)[report]" \
    && rm /tmp/*.whl
# Compiled loops are kept here by whoever runs it; a volume keeps them between containers.
ENV HOME=/tmp/home NUMBA_CACHE_DIR=/tmp/home/numba
RUN mkdir -p /tmp/home/numba && chmod -R 777 /tmp/home
WORKDIR /work
# The first word is the command: predict, train, hand; without one they are listed.
ENTRYPOINT ["sh", "-c", "[ $# -gt 0 ] || exec python -m spgf_torch; command=$1; shift; exec python -m \"spgf_torch.$command\" \"$@\"", "spgf_torch"]
