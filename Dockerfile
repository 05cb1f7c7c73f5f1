# All packages, for a CPU: docker build -t hab-tasks . && docker run --rm -v "$PWD/runs:/work/runs" hab-tasks
FROM python:3.11-slim-trixie
# A software Vulkan driver for images and videos.
RUN apt-get update \
 && apt-get install -y --no-install-recommends libvulkan1 mesa-vulkan-drivers \
 && rm -rf /var/lib/apt/lists/*
COPY . /src
RUN /src/.ci/install /opt/hab && /opt/hab/bin/python /src/.ci/smoke.py /opt/hab && rm -rf /src
ENV PATH=/opt/hab/bin:$PATH
WORKDIR /work
CMD ["hab-eval", "run", "--agent", "hab_spa:spa_priv", "--env", "HabPick-v1", "--episodes", "5", "--out", "runs/demo"]
