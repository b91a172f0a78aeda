# spgf_torch on the CPU: the wheel alone, without the checkout. Build and run:
#   docker build -t spgf_torch --build-arg TORCH_INDEX=INDEX .
#   docker run --rm --user $(id -u):$(id -g) -v $PWD:/work spgf_torch predict cloud.pcd --table find --hand panda
# INDEX: that of torch's builds for the CPU; without it pip may take one with gigabytes of CUDA.
# Not built where it was written, which has no daemon: docs/release.md says which of its steps were run by hand.
ARG PYTHON=3.12

FROM python:${PYTHON}-slim-bookworm AS build
WORKDIR /source
COPY . .
RUN pip install --no-cache-dir "hatchling>=1.26" && hatchling build -t wheel -d /dist

FROM python:${PYTHON}-slim-bookworm
# OpenGL, Vulkan and X11 are what SAPIEN and OpenCV link with; libgomp is torch's. Names are those of Debian 12.
RUN apt-get update \
    && apt-get install -y --no-install-recommends libgl1 libglib2.0-0 libgomp1 libvulkan1 libx11-6 \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /dist/*.whl /tmp/
ARG TORCH_INDEX=""
RUN pip install --no-cache-dir ${TORCH_INDEX:+--index-url "${TORCH_INDEX}"} "torch>=2.6,<2.14" \
    && pip install --no-cache-dir "$(ls /tmp/*.whl)[report]" \
    && rm /tmp/*.whl
# Nobody's home that anybody may write: with --user whoever runs it owns what it leaves in /work. Compiled loops are kept
# in it; a volume there keeps them between containers.
ENV HOME=/home/spgf NUMBA_CACHE_DIR=/home/spgf/numba MPLCONFIGDIR=/home/spgf/matplotlib
RUN useradd --create-home --home-dir /home/spgf spgf \
    && mkdir -p /home/spgf/numba /home/spgf/matplotlib /work \
    && chmod -R 777 /home/spgf /work
USER spgf
WORKDIR /work
ENTRYPOINT ["spgf"]
CMD ["--help"]
