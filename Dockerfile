# deux in a container, with OpenGL for simulator.renderer=gl. With a card: --build-arg TORCH=cuda, and docker run --gpus all.
#     docker build -t deux .
#     docker run --rm -v "$PWD:/work" deux experiment=debug
FROM python:3.11-slim

ARG TORCH=cpu
ENV NVIDIA_DRIVER_CAPABILITIES=compute,utility,graphics

RUN apt-get update && apt-get install -y --no-install-recommends libegl1 libgl1 && rm -rf /var/lib/apt/lists/*

WORKDIR /opt/deux
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY deux deux
COPY plugins plugins
COPY conf conf

RUN python3 -m venv .venv
# torch and torchvision come together, of one build; deux then takes what is there.
RUN if [ "$TORCH" = cpu ]; then .venv/bin/pip install --no-cache-dir torch torchvision -c constraints.txt --index-url https://download.pytorch.org/whl/cpu; fi
RUN .venv/bin/pip install --no-cache-dir -c constraints.txt -e ".[gl]"
RUN .venv/bin/python -m deux.doctor

ENV PATH=/opt/deux/.venv/bin:$PATH
WORKDIR /work
ENTRYPOINT ["python", "-m", "deux"]
CMD ["--help"]
