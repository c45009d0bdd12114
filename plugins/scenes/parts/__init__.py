"""What generated scenes are made of: floor plans, walls, furniture, textures and light."""
